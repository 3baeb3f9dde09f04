"""Base of every component: a name, checked settings, and the identity of its code.

A component is built from its checked settings; the class attributes ``name``
and ``summary`` are what ``palpate plugins`` shows. A study names components by
``name`` and passes their ``settings`` table, which the model of settings checks:
``class Grid(Sampler[GridSettings])``. Every field there needs a description.
"""

from abc import ABC
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Generic, cast, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, PlainSerializer, ValidationInfo
from typing_extensions import TypeVar, get_original_bases

from palpate.fingerprints import CORE, code_fingerprint

Array = Any
"""An array of the array API: numpy in checks, JAX under differentiation."""

NO_FIELDS: Mapping[str, Array] = MappingProxyType({})
"""Where there is no mesh, or a material that takes nothing from it."""


def _in_folder(given: Path, info: ValidationInfo) -> Path:
    """A path from the study's folder; from the current one outside of a study."""
    context = info.context or {}
    path: Path = context.get("folder", Path()) / given
    if context.get("must_exist", True) and not path.is_file():
        raise ValueError(f"'{given}': no such file (looked for {path}); paths are relative to study.toml")
    return path


InputFile = Annotated[
    Path, AfterValidator(_in_folder), PlainSerializer(lambda path: path.name, return_type=str)
]
"""Type of a setting that names a file. Only its name is in keys and manifests: a component with such a
setting adds the content to its ``fingerprint()``."""


class Settings(BaseModel):
    """Base of every component's settings: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


SettingsT = TypeVar("SettingsT", bound=Settings, default=Settings, covariant=True)
"""Settings of a component."""


class Component(ABC, Generic[SettingsT]):
    """Something that a plugin provides under a name.

    Parameters
    ----------
    settings : Settings, optional
        Of the class in brackets, as in ``Sampler[GridSettings]``, which is also the attribute
        ``Settings``; its defaults when left out.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    Settings: ClassVar[type[Settings]] = Settings

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        bases = [
            base for base in get_original_bases(cls) if issubclass(get_origin(base) or object, Component)
        ]
        for argument in (each for base in bases for each in get_args(base)):
            if isinstance(argument, type) and issubclass(argument, Settings):
                cls.Settings = argument
            elif not isinstance(argument, TypeVar):
                raise TypeError(f"class {cls.__name__}[{argument}]: name a subclass of palpate.api.Settings")

    def __init__(self, settings: SettingsT | None = None) -> None:
        self.settings = cast("SettingsT", self.Settings()) if settings is None else settings

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.settings})"

    def fingerprint(self) -> str:
        """Identity of the code that computes, to which results belong; name and settings count anyway.

        By itself distribution, version and a hash of the code of the class and its bases outside
        palpate: of their whole packages, or of the file of a module outside a package. Override it
        to state by hand which versions give the same results, or to add what else they
        depend on, such as a data file.

        Raises
        ------
        PluginError
            The class is defined in no file, as in a notebook.
        """
        return code_fingerprint(type(self)) or f"{CORE} {metadata.version(CORE)}"
