"""Conditions of a deck that hold nodes, in the words of FEBio 2.5 to 4.0: all that are not used are named."""

import re
import xml.etree.ElementTree as ET  # types alone; documents are read by defusedxml
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.api import IntArray
from palpate.api.mesh import Support

RIGID_DOFS = ("Rx", "Ry", "Rz", "Ru", "Rv", "Rw")
TIED = re.compile(r"(?i)tied|sticky")


@dataclass(slots=True, kw_only=True, eq=False)
class DeckNames:
    """Nodes by the names that conditions use."""

    rigid: Mapping[str, IntArray]  # of each rigid body, by the name and the id of its material
    named: Callable[[str], IntArray | None]  # of a set such as @surface:skin; None if there is none
    listed: Callable[[ET.Element], IntArray]  # that an element lists by id
    in_limb: frozenset[int]  # of deformable elements


@dataclass(slots=True, eq=False)
class DeckSupports:
    """Supports of a deck, warnings of what is not used, and surfaces of its contacts that are not tied."""

    root: ET.Element
    names: DeckNames
    supports: list[Support] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def read(self) -> "DeckSupports":
        """Read every condition of the deck and of its steps."""
        for section in self.root.iter("Boundary"):
            for condition in section:
                self._condition(condition)
        for body, nodes in {id(of): (name, of) for name, of in self.names.rigid.items()}.values():
            self._rigid("the limb shares nodes with", body, nodes)
        for contact in self.root.iter("contact"):
            if TIED.search(contact.get("type", "")):
                self._tied(contact)
        for constraint in self.root.iterfind(".//Constraints/constraint"):
            self.warnings.append(
                f"constraint '{_title(constraint)}' of type '{constraint.get('type')}' is not used; if it "
                "holds nodes of the limb, name them in the setting fixed"
            )
        return self

    def pressed(self) -> tuple[str, ...]:
        """Surfaces of the deck's contacts that lie on the limb and are not tied to anything."""
        tied = {c.get("surface_pair") for c in self.root.iter("contact") if TIED.search(c.get("type", ""))}
        sides = [
            side
            for pair in self.root.iter("SurfacePair")
            if pair.get("name") not in tied
            for side in pair_sides(pair)
        ]
        found = {side: self.names.named(f"@surface:{side}") for side in dict.fromkeys(sides)}
        return tuple(
            side
            for side, nodes in found.items()
            if nodes is not None and nodes.size and self.names.in_limb.issuperset(nodes.tolist())
        )

    def _condition(self, condition: ET.Element) -> None:
        kind, title = condition.get("type", condition.tag), _title(condition)
        if condition.tag == "rigid_body":
            return  # read with the rigid bodies
        nodes = self._nodes(condition)
        is_rigid = condition.tag == "rigid" or kind in ("rigid", "rigid deformation")
        if is_rigid and nodes is not None:
            body = condition.get("rb") or _text(condition, "rb")
            self._rigid(f"'{title}' ties nodes to", body, nodes)
            return
        # Conditions on something else than the displacement of solids.
        if re.search(r"(?i)shell|fluid|pressure|concentration|temperature|rotation|dilatation", kind):
            return
        axes, is_moved = _axes(condition, kind)
        if axes is None or nodes is None:
            name = _set_of(condition)
            why = f"of type '{kind}'" if nodes is not None else "without a node set"
            why = f"of '{name}', which is not there," if nodes is None and name else why
            if nodes is None or self._count(nodes):
                self.warnings.append(
                    f"condition '{title}' {why} is not understood and not used; if it holds nodes of the "
                    "limb, name them in the setting fixed"
                )
        elif is_moved and self._count(nodes):
            self.warnings.append(
                f"condition '{title}' moves {self._count(nodes)} nodes of the limb in {axes}; it is no "
                "support and is not used, since the study's protocol moves the indenter"
            )
        elif axes and not is_moved:
            self.supports.append(Support(name=f"'{title}'", nodes=nodes, axes=axes))

    def _nodes(self, condition: ET.Element) -> IntArray | None:
        """Nodes of a condition, by the name of a set or listed in it; None if it has neither."""
        if (name := _set_of(condition)) is not None:
            return self.names.named(name)
        return self.names.listed(condition) if condition.find("node[@id]") is not None else None

    def _count(self, nodes: IntArray) -> int:
        return len(self.names.in_limb.intersection(nodes.tolist()))

    def _tied(self, contact: ET.Element) -> None:
        pairs = {pair.get("name"): pair_sides(pair) for pair in self.root.iter("SurfacePair")}
        sides = pairs.get(contact.get("surface_pair"), ())
        found = [nodes for side in sides if (nodes := self.names.named(f"@surface:{side}")) is not None]
        title = _title(contact)
        for nodes, other in zip(found, found[::-1], strict=True):
            if len(found) != 2 or not self._count(nodes):
                continue
            bodies = [b for b, of in self.names.rigid.items() if np.isin(other, of).all()]
            if bodies:
                self._rigid(f"contact '{title}' ties nodes to", bodies[0], nodes)
            elif self._count(other):
                self.warnings.append(
                    f"contact '{title}' ties two surfaces of the limb; palpate joins elements by shared "
                    "nodes alone, so merge the nodes there"
                )
                return

    def _rigid(self, how: str, body: str, nodes: IntArray) -> None:
        """Add nodes that move with a rigid body: a support where the body is held in all six directions."""
        if not self._count(nodes):
            return
        held = _held_directions(self.root, self._aliases(body))
        if held.issuperset(RIGID_DOFS):
            self.supports.append(Support(name=f"rigid body '{self._aliases(body)[0]}'", nodes=nodes))
        else:
            free = ", ".join(dof for dof in RIGID_DOFS if dof not in held)
            what = "the body's part" if body in self.names.rigid else "a set of them"
            self.warnings.append(
                f"{how} rigid body '{self._aliases(body)[0]}': {self._count(nodes)} nodes of the limb, and "
                f"the deck does not hold the body in {free}; these nodes are free; name {what} in "
                "the setting fixed if it is a bone"
            )

    def _aliases(self, body: str) -> tuple[str, ...]:
        """Names of a rigid body: its material's name first, then its number."""
        materials = ((of.get("name"), of.get("id")) for of in self.root.iterfind("Material/material"))
        return next((tuple(filter(None, names)) for names in materials if body in names), (body,))


def _set_of(condition: ET.Element) -> str | None:
    """Name of the set of a condition; None if it lists its nodes."""
    surface = condition.get("surface")
    return condition.get("node_set") or condition.get("set") or (f"@surface:{surface}" if surface else None)


def pair_sides(pair: ET.Element) -> tuple[str, ...]:
    """Names of the two surfaces of a pair, the primary or slave surface first."""
    sides = (side for tag in ("primary", "slave", "secondary", "master") for side in pair.findall(tag))
    return tuple(filter(None, ((side.get("surface") or side.text or "").strip() for side in sides)))


def _axes(condition: ET.Element, kind: str) -> tuple[str | None, bool]:
    """Axes of a condition (None: not understood), and whether it moves nodes by more than 0."""
    words = kind.lower()
    if words == "zero displacement":
        return "".join(a for a in "xyz" if _text(condition, f"{a}_dof") not in ("", "0")), False
    if words in ("fix", "fixed displacement"):
        return _dofs(condition.get("bc") or condition.get("dofs") or _text(condition, "dofs")), False
    if words in ("prescribe", "prescribed displacement"):
        dof = condition.get("bc") or condition.get("dof") or _text(condition, "dof")
        return _dofs(dof), not _is_zero(condition)
    return None, False


def _dofs(text: str) -> str | None:
    """Axes of a list of degrees of freedom; None for a word that is none of FEBio's."""
    axes = set()
    for word in text.replace(",", " ").split():
        if set(word) <= set("xyz"):
            axes |= set(word)
        elif not re.fullmatch(r"s[xyz]|[uvwptqcdT]\w*|R[xyzuvw]|gR?\w*|w[xyz]|e[fw]|sv[xyz]|va[xyz]?", word):
            return None
    return "".join(sorted(axes))


def _is_zero(condition: ET.Element) -> bool:
    """True if a prescribed displacement is 0 at every node."""
    texts = [e.text for tag in ("value", "scale", "node") for e in condition.findall(tag) if e.text]
    try:
        return bool(texts) and not any(float(text) for text in texts)
    except ValueError:
        return False


def _held_directions(root: ET.Element, body: tuple[str, ...]) -> set[str]:
    """Directions of :data:`RIGID_DOFS` in which the conditions of a deck hold a rigid body."""
    held: set[str] = set()
    for old in root.iter("rigid_body"):
        if (old.get("mat") or _text(old, "mat")) in body:
            for fixed in old:
                if fixed.tag == "fixed" or (fixed.tag == "prescribed" and _number(fixed.text) == 0.0):
                    turns = dict(zip((*"xyz", "Rx", "Ry", "Rz"), RIGID_DOFS, strict=True))
                    held.add(turns.get(fixed.get("bc", ""), ""))
    for new in (*root.iter("rigid_bc"), *root.iter("rigid_constraint")):
        if _text(new, "rb") not in body:
            continue
        words = new.get("type", "")
        if "fix" in words:
            held |= {dof for dof in RIGID_DOFS if _text(new, f"{dof}_dof") not in ("", "0")}
            held |= set(re.split(r"[,\s]+", _text(new, "dofs")))
        elif _number(_text(new, "value")) == 0.0:
            dof = _text(new, "dof")
            own = RIGID_DOFS[3:] if "rotation" in words else RIGID_DOFS[:3]
            held.add(own["xyz".index(dof)] if dof in tuple("xyz") else dof)
    return held


def _number(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None


def _text(element: ET.Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()


def _title(element: ET.Element) -> str:
    """Name of a condition, or else what it is and where."""
    return element.get("name") or element.get("node_set") or element.get("surface_pair") or element.tag
