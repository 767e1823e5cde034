"""The data files a part file names, each read once, with warnings and notes about them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from lmctl.array_types import FloatArray
from lmctl.config.alloy_rules import AlloyRuleFile, AlloyRuleSettings, alloy_rule_findings
from lmctl.config.bodies import CloudBody, MeshBody
from lmctl.config.composition import FaceFeature, SampledMixture, SheetFeature, features_of
from lmctl.config.part_file import PartFile
from lmctl.config.substrate import SubstrateSettings
from lmctl.config.toml_file import parse_tables, validated_model
from lmctl.errors import ConfigError, InputError, MissingFileError
from lmctl.part.sources.alloy_maps import AlloyMap, read_alloy_map
from lmctl.part.sources.files import DataFile, read_data_file
from lmctl.part.sources.mesh_files import Mesh, read_mesh
from lmctl.part.sources.mesh_repair import repair_mesh
from lmctl.part.sources.mesh_topology import remove_slivers

if TYPE_CHECKING:
    from lmctl.part.sources.cloud_files import PointCloud
    from lmctl.part.sources.volumetric_3mf import VoxelProperty


class PartData:
    """Files below a part file's folder, by name.

    sources : {name: sha256} of what was read; warnings, notes : for the user
    """

    def __init__(self, folder: Path, bead_mm: float) -> None:
        self._folder = folder
        self._bead_mm = bead_mm
        self._meshes: dict[tuple[str, str | None, str | None], Mesh] = {}
        self._clouds: dict[tuple[str, str], PointCloud] = {}
        self._sheets: dict[SheetFeature, FloatArray] = {}
        self._voxels: dict[tuple[str, ...], list[VoxelProperty]] = {}
        self._substrate_mesh: Mesh | None = None
        self._substrate_points: FloatArray | None = None
        self.sources: dict[str, str] = {}
        self.warnings: list[str] = []
        self.notes: list[str] = []

    def read(self, part: PartFile) -> None:
        """Read all files a part names.

        Raises MissingFileError where all that is wrong is that files are not there, else
        InputError; either names every file that cannot be used.
        """
        wrong: dict[str, InputError | MissingFileError] = {}
        items = {_key(item): item for item in _filed(part)}
        for item in items.values():
            try:
                if isinstance(item, SheetFeature):
                    self.sheet(item)
                elif isinstance(item, SampledMixture):
                    self.voxels(item, part)
                else:
                    self.points(item)
            except (InputError, MissingFileError) as error:
                wrong[error.render()] = error  # of one file that is not there, however it is used
        if part.substrate.file is not None:
            try:
                self.substrate_points(part.substrate)
            except (InputError, MissingFileError) as error:
                wrong[error.render()] = error
        if len(wrong) == 1:
            raise next(iter(wrong.values()))
        if wrong:
            only_missing = all(isinstance(error, MissingFileError) for error in wrong.values())
            raise (MissingFileError if only_missing else InputError)(
                f"{len(wrong)} data files cannot be used",
                where=[line for e in wrong.values()
                       for line in (e.what, *(f"  {text}" for text in (*e.where, e.hint) if text))],
                hint="mend them and check again with `lmctl check`",
            )

    def mesh(self, body: MeshBody) -> Mesh:
        """A closed mesh, mended where it needed to be. Raises InputError."""
        key = body.file, body.units, body.group
        if key not in self._meshes:
            read = read_mesh(self._file(body.file), body.units, body.group)
            name = body.file if body.group is None else f"{body.file}, group {body.group!r}"
            self._meshes[key], said = repair_mesh(read, name, self._bead_mm)
            self.warnings += said
            self.notes += read.notes
        return self._meshes[key]

    def cloud(self, body: CloudBody) -> PointCloud:
        """Measured points. Raises InputError."""
        key = body.file, body.units
        if key not in self._clouds:
            from lmctl.part.sources.cloud_files import read_cloud  # late: many parts have none

            self._clouds[key] = read_cloud(self._file(body.file), body.units)
            self.notes += self._clouds[key].notes
            self.warnings += self._clouds[key].warnings
        return self._clouds[key]

    def points(self, body: MeshBody | CloudBody) -> FloatArray:
        """(n, 3) float64 [mm]: a mesh's corners or a cloud's points."""
        return self.mesh(body).vertices if isinstance(body, MeshBody) else self.cloud(body).points

    def sheet(self, feature: SheetFeature) -> FloatArray:
        """Triangles (m, 3, 3) float64 [mm] of a surface that need not close. Raises InputError."""
        if feature not in self._sheets:
            mesh = read_mesh(self._file(feature.file), feature.units, may_be_flat=True)
            corners = remove_slivers(mesh.vertices[mesh.triangles])
            if len(corners) == 0:
                raise InputError(f"{feature.file} has no triangle with an area",
                                 hint="export it again")
            self._sheets[feature] = corners
        return self._sheets[feature]

    def voxels(self, sampled: SampledMixture, part: PartFile) -> list[VoxelProperty]:
        """Volume fractions on voxels, one for each material of a part. Raises InputError."""
        from lmctl.part.sources.volumetric_3mf import read_voxel_properties  # late, as above

        names = tuple(sampled.property_of(material.name) for material in part.material)
        key = sampled.file, *names
        if key not in self._voxels:
            found = read_voxel_properties(self._file(sampled.file), names)
            self._voxels[key] = [found[name] for name in names]
        return self._voxels[key]

    def substrate_mesh(self, settings: SubstrateSettings) -> Mesh:
        """The surface of a substrate, which need not close. Raises InputError."""
        assert settings.file is not None, "the model asks for one"
        if self._substrate_mesh is None:
            self._substrate_mesh = read_mesh(self._file(settings.file), settings.units,
                                             may_be_flat=True)
        return self._substrate_mesh

    def substrate_points(self, settings: SubstrateSettings) -> FloatArray:
        """(n, 3) float64 [mm]: the samples of a substrate, or its corners. Raises InputError."""
        if settings.kind == "mesh":
            return self.substrate_mesh(settings).vertices
        assert settings.file is not None, "the model asks for one"
        assert settings.units is not None, "the model asks for them"
        if self._substrate_points is None:
            from lmctl.part.sources.cloud_files import read_cloud  # late, as above

            cloud = read_cloud(self._file(settings.file), settings.units)
            self.notes += cloud.notes
            self.warnings += cloud.warnings
            self._substrate_points = cloud.points
        return self._substrate_points

    def face(self, body: MeshBody, feature: FaceFeature) -> FloatArray:
        """Triangles (m, 3, 3) float64 [mm] of one face of a mesh. Raises InputError."""
        from lmctl.part.faces import smooth_patch_around, triangles_of_group  # late, as above

        if feature.group is not None:
            return triangles_of_group(self._file(body.file), feature.group, body.units)
        assert feature.at_mm is not None, "the model asks for one of the two"
        return smooth_patch_around(self.mesh(body), feature.at_mm, feature.angle_deg)

    def alloy_map(self, rule: AlloyRuleSettings) -> AlloyMap | None:
        """The map of a rule; None where it names none. Raises InputError."""
        if rule.map_file is None:
            return None
        return read_alloy_map(self._file(rule.map_file), rule.powders)

    def shared_alloy_rules(self, name: str) -> tuple[AlloyRuleSettings, ...]:
        """The rules of a file that several parts share. Raises ConfigError with all mistakes."""
        file = self._file(name)
        try:
            data = parse_tables(file.data.decode("utf-8"), name=str(file.path))
        except UnicodeDecodeError:
            raise InputError(f"{file.path} is not text", hint="save it as UTF-8") from None
        findings = list(alloy_rule_findings(data.get("alloy_rule"), None))
        if findings:
            raise ConfigError.of_findings(file.path, findings)
        return validated_model(data, AlloyRuleFile, name=str(file.path)).alloy_rule

    def _file(self, name: str) -> DataFile:
        file = read_data_file(name, self._folder)
        self.sources[name] = file.sha256
        return file


def _key(item: MeshBody | CloudBody | SheetFeature | SampledMixture) -> tuple[str | None, ...]:
    """Equal for what is read once."""
    if isinstance(item, SampledMixture):
        return "sampled", item.file, repr(sorted(item.properties.items()))
    return item.kind, item.file, item.units, item.group if isinstance(item, MeshBody) else None


def _filed(part: PartFile) -> Iterator[MeshBody | CloudBody | SheetFeature | SampledMixture]:
    """What of a part is in files, in the part file's order."""
    for body in part.body:
        if isinstance(body, MeshBody | CloudBody):
            yield body
    for holder in (part, *part.body):
        if holder.composition is not None:
            yield from (f for f in features_of(holder.composition) if isinstance(f, SheetFeature))
            if holder.composition.sampled is not None:
                yield holder.composition.sampled
