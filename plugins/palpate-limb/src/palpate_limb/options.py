"""Options of ``palpate limb SCAN``: keys of a TOML file, some of them options of the command line too."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationInfo,
    field_validator,
)

from palpate.api import MeshError, Quantity, Settings, Sphere
from palpate.api.mesh import RIM
from palpate_limb.layers import layer_order
from palpate_limb.marks import Colour
from palpate_limb.meshing import SizeField
from palpate_limb.places import Place, place_of
from palpate_limb.surfaces import mm_per_unit
from palpate_limb.volume import FLATTEST, TISSUE, MeshPlan

DEFAULT_SIZE = 0.18
"""Edge length at the edge of the contact over the indenter's radius; ``mesh_error`` has its error."""
TOLERANCE_MM, LAYERED_TOLERANCE_MM = 0.6, 0.4
"""Distance between a mesh and the surfaces before it is bent onto them; thin layers need a smaller one."""
DEFAULT_LENGTH = 80.0 / 7.5
"""Length of a segment over the indenter's radius; docs/limb.md has what it costs."""

DEFAULT_MARKS: dict[str, Colour | None] = {"p1": "red", "p2": "green", "p3": "blue", "p4": "yellow"}

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=100)]
Length = Annotated[
    float, Quantity("mm"), Field(gt=0.0), PlainSerializer(lambda mm: f"{mm:.12g} mm", return_type=str)
]


def _path(given: Path, info: ValidationInfo) -> Path:
    """A path relative to the file that names it, or to the current folder on the command line."""
    context = info.context or {}
    return given if info.field_name in context.get("given", ()) else context.get("folder", Path()) / given


File = Annotated[Path, Field(strict=False), AfterValidator(_path)]


@dataclass(frozen=True, slots=True)
class BoneFile:
    """A file of one bone or several; of the scan itself, its largest part is the skin.

    ``names`` name its bones in the order of the file; by default one bone has the name of the file.
    """

    path: Path
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{','.join(self.names)}={self.path}" if self.names else str(self.path)


def _bone_file(given: object, info: ValidationInfo) -> BoneFile:
    names, _, path = str(given).rpartition("=")
    each = tuple(name.strip() for name in names.split(",")) if "=" in str(given) else ()
    if not all(re.fullmatch(r"[\w-]+", name) for name in each) or len(set(each)) < len(each):
        raise ValueError(f"{given}: give each bone a name of its own, of letters, digits, - and _")
    return BoneFile(_path(Path(path), info), each)


def _direction(given: object) -> list[float]:
    numbers = [float(x) for x in given if type(x) in (int, float)] if isinstance(given, list) else []
    if len(numbers) == 3 and any(numbers) and np.isfinite(numbers).all():
        return numbers
    raise ValueError(f"{given}: give three numbers, not all 0, such as [0, 0, 1]")


def _axis(given: object) -> list[float] | str:
    return given if isinstance(given, str) and given else _direction(given)


def _place(text: str) -> str:
    place_of(text)
    return text


def _unit(given: str) -> str:
    if not mm_per_unit(given) > 0.0:
        raise ValueError(f"{given}: give more than 0 mm")
    return given


Bone = Annotated[BoneFile, PlainValidator(_bone_file), PlainSerializer(str, return_type=str)]
Unit = Annotated[str, AfterValidator(_unit)]


def _ascending(given: list[float]) -> list[float]:
    if len(given) != 2 or not given[0] < given[1]:
        raise ValueError("give the least and, after it, a larger one")
    return given


def _by_name(given: object) -> object:
    """Marks without colours, which are a list of names."""
    names = given if isinstance(given, list) and all(isinstance(name, str) for name in given) else None
    return given if names is None or len(set(names)) < len(names) else dict.fromkeys(names)


class ScanOptions(Settings, strict=True):
    """Options of a scan; docs/limb.md documents every key."""

    bones: list[Bone] = Field(default=[])
    zero: Annotated[list[float], PlainValidator(_direction)] | None = None  # of 0 degrees around the limb
    spot: dict[Name, Annotated[str, AfterValidator(_place)]] = Field(default={}, validate_default=True)
    mark: Annotated[dict[Name, Colour | None], BeforeValidator(_by_name)] = DEFAULT_MARKS
    mark_radii: Annotated[list[Length], AfterValidator(_ascending)] = Field(default=[1.2, 10.0])
    into: File = Path("meshes")
    unit: Unit | None = None  # the one in which the scan is a limb
    bone_unit: Unit | None = None  # None: the unit of the scan
    axis: Annotated[list[float] | str, PlainValidator(_axis)] | None = None  # or a bone; the long one
    motion: File | None = None  # of the bones to the scan: 4 × 4 numbers
    landmarks: File | None = None  # the same by points: x,y,z of the bones and of the scan
    reference: File | None = None  # skin or mould in the bones' frame, laid onto the scan
    cover: Length | None = None  # least tissue over a bone, whose points move inwards for it
    repair: bool = False
    smoothing: int = Field(default=20, ge=0, le=200)  # rounds of Taubin's filter; spots are found without
    stump: bool = False  # the limb ends in skin
    radius: Length = 7.5  # of the sphere
    depth: Length | None = None  # of the deepest press; the radius
    length: Length | None = None  # of a segment
    size: Length | None = None  # edge at the edge of the contact
    fine: bool = False  # finer meshes too
    layer: dict[Name, Length] = Field(default={})  # thickness, from the outside in
    layer_at: dict[Name, dict[Name, Length]] = Field(default={})  # where a spot has its own
    core: Name = TISSUE  # region below all layers

    @field_validator("spot")
    @classmethod
    def _spots_for(cls, given: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        if not given and info.data.get("zero"):
            raise ValueError("missing, and zero is for it; add [spot] NAME = PLACE, or leave zero out")
        return given

    @field_validator("mark")
    @classmethod
    def _one_kind(cls, given: dict[str, str | None], info: ValidationInfo) -> dict[str, str | None]:
        if info.data.get("spot"):
            raise ValueError("give the spots by place (spot) or by ink (mark), not both")
        if len({colour is None for colour in given.values()}) > 1:
            raise ValueError("give every mark a colour, or none of them")
        return given

    @field_validator("landmarks")
    @classmethod
    def _one_way(cls, given: Path | None, info: ValidationInfo) -> Path | None:
        if given and info.data.get("motion"):
            raise ValueError("both a motion and landmarks; give one of them")
        return given

    @property
    def length_mm(self) -> float:
        """Length of a segment."""
        return self.length or DEFAULT_LENGTH * self.radius

    @property
    def reach_mm(self) -> float:
        """Radius of the deepest contact."""
        return Sphere(radius_mm=self.radius).reach_mm(self.depth or self.radius)

    @property
    def places(self) -> dict[str, Place]:
        """Place of each spot that is not marked by ink."""
        return {name: place_of(text) for name, text in self.spot.items()}

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of all layers, from the skin inwards; a MeshError where their order is open."""
        return layer_order([list(named) for named in (self.layer, *self.layer_at.values())])

    @property
    def mesh(self) -> MeshPlan:
        """Plan of a mesh without layers of its own: fine at the contact's edge, coarse away from it."""
        fine = self.size or DEFAULT_SIZE * self.radius
        return MeshPlan(
            size=SizeField(
                fine_mm=fine,
                coarse_mm=max(2.4 * self.radius, fine),
                radius_mm=RIM[1] * self.reach_mm,
                inner_mm=RIM[0] * self.reach_mm,
            ),
            layers_mm={name: self.layer[name] for name in self.layers if name in self.layer},
            core=self.core,
            tolerance_mm=LAYERED_TOLERANCE_MM if self.layers else TOLERANCE_MM,
        )

    def mesh_at(self, spot: str) -> MeshPlan:
        """Plan of the mesh of a spot; a MeshError where a layer has no thickness, or too little."""
        known = self.layer | self.layer_at.get(spot, {})
        if missing := [name for name in self.layers if name not in known]:
            raise MeshError(
                f"spot '{spot}': layer '{missing[0]}' has a thickness at other spots and none here; give "
                "one for this spot, or for all"
            )
        made = replace(self.mesh, layers_mm={name: known[name] for name in self.layers})
        for name, thickness in made.layers_mm.items():
            needed = FLATTEST * thickness
            if made.size.fine_mm > needed * (1.0 + 1e-9):
                raise MeshError(
                    f"spot '{spot}': layer '{name}' of {thickness:g} mm is thinner than half an edge of "
                    f'{made.size.fine_mm:.3g} mm. Its elements would be slivers. Set size = "{needed:.3g} mm"'
                )
        return made
