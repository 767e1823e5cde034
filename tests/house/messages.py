"""Which error messages of the code a run of the tests has brought about.

    LMCTL_MESSAGES=FOLDER python -m pytest -p tests.house.message_log
    python -m tests.house.messages FOLDER

A message counts as tested where its own place in the code made a text, and that text was part of
what an error, a finding or a mistake said, in one process. Prints how many messages there are, and
those that no test reaches.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path

from tests.house.message_sites import MessageSites, Site


def untested(folders: Iterable[Path], sites: Iterable[Site]) -> list[Site]:
    """Messages that no run which wrote into one of the folders has reached."""
    reached = {key for folder in folders for path in folder.glob("*.json")
               for key in json.loads(path.read_text(encoding="utf-8"))}
    return [site for site in sites if site.key not in reached]


def main(arguments: list[str]) -> int:
    if not arguments:
        print(__doc__)
        return 2
    known = MessageSites().all()
    missing = untested(map(Path, arguments), known)
    for site in missing:
        print(f"{site.path}:{site.line}: {site.pattern}")
    print(json.dumps({"messages": len(known), "untested": len(missing),
                      "messages_tested": round(1 - len(missing) / len(known), 3)}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
