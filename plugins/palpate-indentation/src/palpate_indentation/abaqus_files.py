"""Input files of Abaqus and CalculiX as contents of a mesh file, with everything that holds nodes."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.api.mesh import Support
from palpate_indentation.abaqus_model import SOLID, Keyword, Model
from palpate_indentation.mesh_content import MeshFile

TYPED: Mapping[str, str] = MappingProxyType(
    {
        "ENCASTRE": "xyz",
        "PINNED": "xyz",
        "XSYMM": "x",
        "YSYMM": "y",
        "ZSYMM": "z",
        "XASYMM": "yz",
        "YASYMM": "xz",
        "ZASYMM": "xy",
        "NOWARP": "",
        "NOOVAL": "",
        "NODEFORM": "",
    }
)
"""Axes that a named boundary condition holds."""
HOLDS = ("MPC", "EQUATION", "KINEMATICCOUPLING", "DISTRIBUTINGCOUPLING", "EMBEDDEDELEMENT")
"""Conditions that may hold nodes and that are not used."""


def read_abaqus(path: Path) -> MeshFile:
    """Contents of an input file, with those that it includes from its own folder.

    Raises
    ------
    MeshError
        Something cannot be read; with the line, and what to do.
    """
    model = Model(path).read()
    supports, warnings = _Conditions(model).read()
    blocks = tuple((kind, np.array(cells, dtype=np.int64)) for kind, cells in model.cells.items() if cells)
    kinds = [kind for kind, _ in blocks]
    return MeshFile(
        points=np.array(model.points, dtype=np.float64).reshape(-1, 3),
        blocks=blocks,
        point_sets={
            model.written(name): _sorted(nodes)
            for name, nodes in (*model.surfaces.items(), *model.sets.items())
        },
        cell_sets={
            model.written(name): _rows(model, members, kinds) for name, members in model.groups.items()
        },
        supports=tuple(supports),
        remarks=tuple(
            f"{n} elements of type {kind} are no tissue and are left out"
            for kind, n in model.left_out.items()
        ),
        warnings=(*model.unused, *warnings),
    )


def _rows(model: Model, members: set[tuple[str, int]], kinds: list[str]) -> tuple[NDArray[np.int64], ...]:
    """Rows of the members of an element set in the block of each kind."""
    rows: dict[str, list[int]] = {kind: [] for kind in kinds}
    for kind, row in (model.owners[e] for e in members if e in model.owners):
        rows[kind].append(row)
    return tuple(np.array(sorted(rows[kind]), dtype=np.int64) for kind in kinds)


def _sorted(nodes: set[int]) -> NDArray[np.int64]:
    return np.array(sorted(nodes), dtype=np.int64)


class _Conditions:
    """Boundary conditions, rigid bodies, ties and couplings of a model."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.supports: list[Support] = []
        self.warnings: list[str] = []
        self.held: dict[int, set[int]] = {}
        self.single: dict[str, set[int]] = {}  # nodes that conditions name by number, by their axes
        self.limb = {
            n for kind, cells in model.cells.items() if kind.startswith(SOLID) for c in cells for n in c
        }

    def read(self) -> tuple[list[Support], list[str]]:
        keywords = [keyword for _, keyword in self.model.later]
        for keyword in keywords:
            if keyword.name == "BOUNDARY":
                self.boundary(keyword)
        self.supports += [
            _support("*Boundary of numbers", nodes, axes) for axes, nodes in self.single.items()
        ]
        bodies = [self.rigid(keyword) for keyword in keywords if keyword.name == "RIGIDBODY"]
        for keyword, following in zip(keywords, [*keywords[1:], None], strict=False):
            if keyword.name == "COUPLING":
                self.coupling(keyword, following)
            elif keyword.name == "TIE":
                self.tie(keyword, [body for body in bodies if body])
            elif keyword.name in HOLDS:
                self.warnings.append(
                    f"*{keyword.name} in line {keyword.line} may hold nodes of the limb and is not used; "
                    "name those nodes under fixed"
                )
        return self.supports, self.warnings

    def boundary(self, keyword: Keyword) -> None:
        if keyword.options.get("OP", "").upper() == "NEW" and (self.supports or self.single):
            self.warnings.append(
                f"*Boundary, op=NEW in line {keyword.line} removes earlier conditions in its step; palpate "
                "uses all of them; delete those that do not hold during the press"
            )
        elsewhere = next((word for word in ("SUBMODEL", "USER") if word in keyword.options), "")
        for row in keyword.rows:
            nodes = self.nodes(row[0], keyword)
            if elsewhere and self.limb.intersection(nodes):
                self.warnings.append(
                    f"*Boundary, {elsewhere.lower()} in line {keyword.line} moves {len(nodes)} nodes by "
                    "another model or program and is not used; name these nodes under fixed if they are held"
                )
            if elsewhere:
                continue
            title = f"*Boundary of '{row[0]}'"
            label = row[1].upper() if len(row) > 1 else ""
            if label in TYPED:
                axes, held = (
                    TYPED[label],
                    {"ENCASTRE": range(1, 7), "PINNED": range(1, 4)}.get(label, range(0)),
                )
            else:
                dofs = [int(self.model.number(keyword, cell)) for cell in row[1:3] if cell]
                if not dofs:
                    raise self.model.refused(
                        keyword, f"'{', '.join(row)}' names no direction; write 1, 2 or 3"
                    )
                held = range(dofs[0], dofs[-1] + 1)
                axes = "".join("xyz"[d - 1] for d in held if 1 <= d <= 3)
                moved = self.model.number(keyword, row[3]) if len(row) > 3 and row[3] else 0.0
                if moved and "FIXED" not in keyword.options:
                    if axes and self.limb.intersection(nodes):
                        self.warnings.append(
                            f"{title} moves {len(self.limb.intersection(nodes))} nodes of the limb; it is no "
                            "support and is not used, since the study's protocol moves the indenter"
                        )
                    continue
            for node in nodes:
                self.held.setdefault(node, set()).update(held)
            if axes and len(nodes) == 1 and row[0].isdigit():
                self.single.setdefault(axes, set()).update(nodes)
            elif axes:
                self.supports.append(_support(title, nodes, axes))

    def nodes(self, cell: str, keyword: Keyword) -> set[int]:
        """Nodes that a condition names: a set, a node, or either within an instance."""
        model, member = self.model, self.model.member(cell)
        if isinstance(member, int):
            return {model.node("", member, f"*{keyword.name}")}
        found = model.sets.get(member)
        if found is None:
            head, _, tail = member.rpartition(".")
            if head and tail.isdigit():
                return {model.node(head, int(tail), f"*{keyword.name}")}
            raise model.refused(keyword, f"no node set '{model.written(member)}'; define it")
        return found

    def reference(self, keyword: Keyword) -> int | None:
        """Reference node of a rigid body or coupling."""
        named = keyword.options.get("REFNODE", "")
        nodes = self.nodes(named, keyword) if named else set()
        return next(iter(nodes)) if len(nodes) == 1 else None

    def moves_with(self, how: str, nodes: set[int], reference: int | None) -> None:
        """Nodes of the limb that move with a reference node: a support if that is held in all directions."""
        on_limb = self.limb.intersection(nodes)
        if not on_limb:
            return
        held = self.held.get(-1 if reference is None else reference, set())
        if held.issuperset(range(1, 7)):
            self.supports.append(_support(how, nodes, "xyz"))
        else:
            self.warnings.append(
                f"{how} moves {len(on_limb)} nodes of the limb with a reference node that the file does not "
                "hold in all six directions; these nodes are free; name their set under fixed if it is a bone"
            )

    def rigid(self, keyword: Keyword) -> tuple[set[int], int | None]:
        """Nodes of a rigid body and its reference node; its solid elements are no limb."""
        model, nodes = self.model, set[int]()
        for option in ("ELSET", "PINNSET", "TIENSET"):
            if option in keyword.options:
                name = model.title(keyword, option)
                if option == "ELSET":
                    members = model.groups.get(name, set())
                    nodes |= model.nodes_of_elements(members)
                    self.leave_out(members, name)
                else:
                    nodes |= model.sets.get(name, set())
        reference = self.reference(keyword) if nodes else None  # of an analytical tool
        self.moves_with(f"the rigid body in line {keyword.line}", nodes, reference)
        return nodes, reference

    def leave_out(self, members: set[tuple[str, int]], name: str) -> None:
        """Delete solid elements of a rigid body from the model."""
        model = self.model
        gone = {e for e in members if e in model.owners and model.owners[e][0].startswith(SOLID)}
        for kind in {model.owners[e][0] for e in gone}:
            rows = {model.owners[e][1] for e in gone if model.owners[e][0] == kind}
            kept = [k for k in range(len(model.cells[kind])) if k not in rows]
            place = {old: new for new, old in enumerate(kept)}
            model.cells[kind] = [model.cells[kind][k] for k in kept]
            for e in [e for e, (of, _) in model.owners.items() if of == kind]:
                row = model.owners.pop(e)[1]
                if row in place:
                    model.owners[e] = (kind, place[row])
        if gone:
            model.left_out[f"'{model.written(name)}' (rigid body)"] = len(gone)
            self.limb = {
                n for kind, cells in model.cells.items() if kind.startswith(SOLID) for c in cells for n in c
            }

    def coupling(self, keyword: Keyword, following: Keyword | None) -> None:
        """Nodes of a surface that move with a reference node, in all directions or in some."""
        name = self.model.title(keyword, "SURFACE")
        nodes = self.model.surfaces.get(name, self.model.sets.get(name, set()))
        if following is None or following.name != "KINEMATIC":
            if self.limb.intersection(nodes):
                self.warnings.append(
                    f"*Coupling of '{self.model.written(name)}' is not used; name its nodes under fixed if "
                    "they are held"
                )
            return
        self.moves_with(f"*Coupling of '{self.model.written(name)}'", nodes, self.reference(keyword))

    def tie(self, keyword: Keyword, bodies: list[tuple[set[int], int | None]]) -> None:
        """Nodes of the limb that are tied to a rigid body, or to another part of the limb."""
        for row in keyword.rows:
            names = [self.model.member(cell) for cell in row[:2] if cell]
            sides = [self.model.surfaces.get(str(n), self.model.sets.get(str(n), set())) for n in names]
            if len(sides) != 2:
                continue
            title = f"*Tie of '{' to '.join(self.model.written(str(n)) for n in names)}'"
            for nodes, other in (sides, sides[::-1]):
                body = next((body for body in bodies if other and other <= body[0]), None)
                if body is not None:
                    self.moves_with(title, nodes, body[1])
            if all(self.limb.intersection(side) for side in sides):
                self.warnings.append(
                    f"{title} ties two surfaces of the limb; palpate joins elements by shared nodes alone, "
                    "so merge the nodes there"
                )


def _support(name: str, nodes: set[int], axes: str) -> Support:
    return Support(name=name, nodes=_sorted(nodes), axes=axes)
