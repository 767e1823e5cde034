"""`lmctl report RUN --as-built`: what was built against what was designed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from lmctl.cli.console import print_data
from lmctl.errors import JournalError, UsageError

if TYPE_CHECKING:
    from lmctl.as_built.comparison import AsBuiltComparison

PICTURES = (".png", ".svg")
FORMS = (".txt", ".json", ".vti", *PICTURES)


def report_as_built(
    run: str, runs_dir: Path, output: Path | None, layers: tuple[int, ...], data: Path | None,
    copy: str | None, *, as_json: bool,
) -> None:
    """Print the comparison, or write it in the form that the ending of `output` names.

    output : a folder receives text, JSON, .vti and a picture of each layer
    layers : numbers, from 1, of the layers to draw; empty: the middle one
    copy : of a job with copies, the one to compare; None: prints all of them
    Raises UsageError, and whatever the comparison raises.
    """
    is_folder = output is not None and (output.is_dir() or not output.suffix)
    form = "" if output is None or is_folder else output.suffix.lower()
    if form and form not in FORMS:
        raise UsageError(f"cannot write an as-built report as {form}", where=str(output),
                         hint="choose a folder, or one of .html, .pdf, " + ", ".join(FORMS))
    if layers and not (is_folder or form in PICTURES):
        raise UsageError("--layer is for pictures",
                         hint="-o FILE.png draws one layer, -o FOLDER as many as you name")
    if len(layers) > 1 and not is_folder:
        raise UsageError("one file holds the picture of one layer", hint="-o FOLDER takes several")
    if output is None and copy is None and (names := copies_of_run(run, runs_dir)):
        compared = {name: compared_with_design(run, runs_dir, data, layers, name)
                    for name in names}
        if as_json:
            print_data(json.dumps({"copies": {
                name: found.summary.as_json() for name, (found, _, _) in compared.items()}},
                ensure_ascii=False, allow_nan=False))
        else:
            print_data("\n\n".join(_as_text(found, f"{title}, {name}")
                                   for name, (found, title, _) in compared.items()))
        return
    found, title, heights = compared_with_design(run, runs_dir, data, layers, copy)
    if output is None:
        print_data(_as_json(found) if as_json else _as_text(found, title))
        return
    try:
        if is_folder:
            output.mkdir(parents=True, exist_ok=True)
        for target in _targets(output, heights) if is_folder else [output]:
            _write(found, title, target, heights)
            print_data(str(target))
    except OSError as error:
        raise UsageError.cannot_write(error.filename or output, error) from None


def copies_of_run(run: str, runs_dir: Path) -> list[str]:
    """Names of the copies in a run's job; empty for a part alone."""
    from lmctl.cli.log import find_journal
    from lmctl.job.reader import JobReader
    from lmctl.run.journal.run_folders import RunFolder

    with JobReader(RunFolder(find_journal(run, runs_dir).parent).job) as job:
        return [str(one["name"]) for one in job.manifest.totals.get("copies", [])]


def compared_with_design(
    run: str, runs_dir: Path, data: Path | None, layers: tuple[int, ...], copy: str | None = None
) -> tuple[AsBuiltComparison, str, dict[int, float]]:
    """The comparison, its title, and the heights of the layers to draw in the part's own frame."""
    from lmctl.cli.log import find_journal
    from lmctl.job.reader import JobReader
    from lmctl.report.as_built_run import as_built_of_run
    from lmctl.run.journal.format import verify_journal
    from lmctl.run.journal.run_folders import RunFolder

    journal = find_journal(run, runs_dir)
    with JobReader(RunFolder(journal.parent).job) as job:
        entries = job.manifest.layers
        title = f"{journal.parent.name}, {job.manifest.part_name}"
        for layer in layers:
            if not 1 <= layer <= len(entries):
                raise UsageError(f"there is no layer {layer}",
                                 where=f"the job has layers 1 to {len(entries)}",
                                 hint="choose one of them with --layer")
        wanted = layers or ((len(entries) + 1) // 2,)
        layer_mm = entries[1].z_mm - entries[0].z_mm if len(entries) > 1 else entries[0].z_mm
        heights = {
            layer: entries[layer - 1].z_mm - layer_mm / 2 - job.manifest.part_offset_mm[2]
            for layer in wanted}
    try:
        return as_built_of_run(journal, data, copy), title, heights
    except (KeyError, TypeError, AttributeError):
        verified = verify_journal(journal)
        if verified.intact:  # it is what was written, so we do not understand ourselves
            raise
        raise JournalError(
            f"{journal} was damaged or altered, and nothing can be compared by it",
            where=f"line {verified.broken_line}: {verified.reason}",
            hint="restore the journal from a copy") from None


def _targets(folder: Path, heights: dict[int, float]) -> list[Path]:
    return [folder / "as-built.txt", folder / "as-built.json", folder / "as-built.vti",
            *(folder / f"layer-{layer:04d}.png" for layer in heights)]


def _write(
    found: AsBuiltComparison, title: str, target: Path, heights: dict[int, float]
) -> None:
    form = target.suffix.lower()
    if form == ".txt":
        target.write_text(_as_text(found, title) + "\n", encoding="utf-8")
    elif form == ".json":
        target.write_text(_as_json(found) + "\n", encoding="utf-8")
    elif form == ".vti":
        from lmctl.report.as_built_field import write_as_built_field

        write_as_built_field(found, target)
    else:
        from lmctl.report.as_built_picture import draw_as_built_plane

        layer = next((one for one in heights if target.stem == f"layer-{one:04d}"), None)
        layer = next(iter(heights)) if layer is None else layer
        how = "" if found.summary.built_by == "simulated" else f", {found.summary.built_by}"
        draw_as_built_plane(found, heights[layer], f"{title}, layer {layer}{how}", target)


def _as_text(found: AsBuiltComparison, title: str) -> str:
    from lmctl.report.as_built_text import as_built_as_text

    return as_built_as_text(title, found.summary)


def _as_json(found: AsBuiltComparison) -> str:
    return json.dumps(found.summary.as_json(), ensure_ascii=False, allow_nan=False)
