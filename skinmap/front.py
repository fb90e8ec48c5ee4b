"""What public functions take beside their own types: names and files, and one line for the rest.

`skinmap.flatten("icub", part="torso")` works where a surface mesh is asked for: a robot's name
becomes a robot, its part a skin, the skin a mesh. A value that nothing can be made of is answered
with the parameter, the type that came and the types that fit, in place of an error from inside.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from skinmap.errors import MissingFileError, SkinError, WrongTypeError

if TYPE_CHECKING:
    from skinmap.flat.flat_map import FlatMap
    from skinmap.recognition.classifier import Classifier
    from skinmap.skin.robot import Robot
    from skinmap.skin.skin import Skin
    from skinmap.surface.surface_mesh import SurfaceMesh
    from skinmap.touch.recording import Recording

F = TypeVar("F", bound=Callable[..., Any])
PART = "part"  # the keyword that chooses a skin where a robot is given
NAMED = re.compile(r"\b[A-Za-z_]\w*")
# Words of annotations that any value may fit.
OPEN = {"Any", "ArrayLike", "Callable", "Sequence", "Iterable", "Mapping", "Literal", "object"}
PUBLIC = {"TouchClassifier": "Classifier"}  # other names in annotations of public classes
NAMES = ("Sequence[str]", "Sequence[str] | None")  # where one name is as good as a list of it
RETURNS = "\n\n    Returns\n"
PART_TOLD = """
    part : str, optional
        The part whose skin is meant, where a robot or its name is given first."""
INSIDE = (AttributeError, TypeError, KeyError, IndexError, ValueError)


def robots() -> tuple[str, ...]:
    """Names of the robots that ship, and of those of plug-ins.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import skinmap
    >>> "icub" in skinmap.robots()
    True
    """
    from skinmap.io.robots.manifest import builtin_robots

    return builtin_robots()


def gestures() -> tuple[str, ...]:
    """Names of the gestures that `simulate` makes.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import skinmap
    >>> "poke" in skinmap.gestures()
    True
    """
    from skinmap.touch.simulation.hands import EVERY

    return EVERY


def flatteners() -> tuple[str, ...]:
    """Names of the methods that `flatten` takes, those of plug-ins too.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import skinmap
    >>> "balanced" in skinmap.flatteners()
    True
    """
    from skinmap.flat.methods import flatteners as registry

    return registry.names()


def classifiers() -> tuple[str, ...]:
    """Names of the classifiers that `train` takes, those of plug-ins too.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import skinmap
    >>> "contact-geometry" in skinmap.classifiers()
    True
    """
    from skinmap.recognition.catalogue import classifiers as registry

    return registry.names()


def accepting(function: F) -> F:
    """A public function that takes names and files too, and names arguments of a wrong type.

    Parameters
    ----------
    function : callable
        Its annotations state the types that it takes.

    Returns
    -------
    callable

    Raises
    ------
    WrongTypeError
        An argument of a type that does not fit, when the function failed on it.

    Examples
    --------
    >>> import skinmap
    >>> skinmap.flatten("kaspar", part="torso").charts[0].distortion.flips
    0
    """
    signature = inspect.signature(function)
    parameters = signature.parameters
    asked = {name: _words(one.annotation) for name, one in parameters.items()}
    several = {name for name, one in parameters.items() if one.annotation in NAMES}
    first = next(iter(parameters), "")
    takes_part = PART not in parameters and bool(asked.get(first, set()) & PARTED)

    def subject(arguments: tuple[Any, ...], options: Mapping[str, Any]) -> Any:
        return arguments[0] if arguments else options.get(first)

    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        from skinmap.skin.robot import Robot

        part = options.pop(PART, None) if takes_part else None
        if part is not None and not isinstance(subject(arguments, options), str | Path | Robot):
            raise WrongTypeError(
                f"{function.__name__}: part chooses a skin of a robot, and {first} is "
                f"{_shown(subject(arguments, options))}"
            )
        named = dict(zip(parameters, arguments, strict=False))
        for given in (named, options):
            given.update({k: (given[k],) for k in several if isinstance(given.get(k), str)})
        arguments = (*named.values(), *arguments[len(named) :])
        try:
            if arguments and first in parameters:
                arguments = (_made(arguments[0], asked[first], part), *arguments[1:])
        except MissingFileError as error:  # arguments in the wrong order, perhaps
            rest = {k: v for k, v in named.items() if {type(v).__name__} & asked[first]}
            raise _misfit(function.__name__, parameters, rest) or error from error
        named = dict(zip(parameters, arguments, strict=False))
        arguments = (
            tuple(_made(v, asked.get(k, set())) for k, v in named.items()) + arguments[len(named) :]
        )
        options = {k: _made(v, asked.get(k, set()), part) for k, v in options.items()}
        try:
            return function(*arguments, **options)
        except SkinError:
            raise
        except INSIDE as error:
            wrong = _wrong(function.__name__, signature, arguments, options)
            if wrong is None:
                raise
            raise wrong from error

    if takes_part:
        own = inspect.Parameter(PART, inspect.Parameter.KEYWORD_ONLY, default=None,
                                annotation="str | None")  # fmt: skip
        call.__signature__ = signature.replace(parameters=[*parameters.values(), own])  # type: ignore[attr-defined]
        call.__doc__ = (function.__doc__ or "").replace(RETURNS, PART_TOLD + RETURNS, 1)
    call.__module__ = "skinmap"  # where it is found again when it is sent to another process
    return call  # type: ignore[return-value]


def _words(annotation: Any) -> set[str]:
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "Any")
    return {PUBLIC.get(word, word) for word in NAMED.findall(text)}


def _wrong(
    called: str, signature: inspect.Signature, arguments: Sequence[Any], options: Mapping[str, Any]
) -> WrongTypeError | None:
    """The first argument of another type than its annotation, or that has no parameter."""
    parameters = signature.parameters
    given = {**dict(zip(parameters, arguments, strict=False)), **options}
    if wrong := _misfit(called, parameters, given):
        return wrong
    try:
        signature.bind(*arguments, **options)
    except TypeError as error:
        return WrongTypeError(f"{called}: {error}; it takes {', '.join(parameters)}")
    return None


def _misfit(
    called: str, parameters: Mapping[str, inspect.Parameter], given: Mapping[str, Any]
) -> WrongTypeError | None:
    """The first of some arguments that is of another type than its annotation."""
    for name, value in given.items():
        if name not in parameters:
            break
        annotation = parameters[name].annotation
        kinds = {one.__name__ for one in type(value).__mro__} - {"object"}
        wanted = _words(annotation)
        fits = wanted & kinds or (value is None and "None" in wanted)
        number = {"int", "integer", "float", "floating"} & kinds
        scalar = "float" in wanted or isinstance(parameters[name].default, float)
        if number and scalar:
            continue
        plain = {"str", "int", "float", "bool", "dict"} & {type(value).__name__}
        foreign = wanted & OPEN and not (plain or type(value).__module__.startswith("skinmap"))
        foreign = foreign and not ("ndarray" in kinds and wanted & set(MAKERS))
        if not fits and not foreign and wanted:
            words = NAMED.sub(lambda found: PUBLIC.get(found[0], found[0]), str(annotation))
            return WrongTypeError(f"{called}: {name} must be {words}, not {_shown(value)}")
    return None


def _shown(value: Any) -> str:
    return f"{type(value).__name__} {value!r}" if isinstance(value, str) else type(value).__name__


def _made(value: Any, wanted: set[str], part: str | None = None) -> Any:
    """The value, or what it stands for where that is one of the wanted types."""
    kinds = {one.__name__ for one in type(value).__mro__}
    if kinds & wanted:
        return value
    for kind, make in MAKERS.items():
        if kind in wanted:
            return make(value, part)
    return value


def _robot(value: Any, _: str | None) -> Robot | Any:
    from skinmap.io.robots.manifest import load_robot

    return load_robot(value) if isinstance(value, str | Path) else value


def _skin(value: Any, part: str | None) -> Skin | Any:
    from skinmap.skin.robot import Robot

    robot = _robot(value, None)
    if not isinstance(robot, Robot):
        return value
    if part is None:
        raise WrongTypeError(f"{robot.name} has several skins: add part=..., one of "
                             f"{', '.join(robot.parts)}")  # fmt: skip
    return robot.skin(part)


def _mesh(value: Any, part: str | None) -> SurfaceMesh | Any:
    from skinmap.skin.skin import Skin
    from skinmap.surface.surface_mesh import build_surface

    skin = _skin(value, part)
    return build_surface(skin) if isinstance(skin, Skin) else skin


def _flat(value: Any, part: str | None) -> FlatMap | Any:
    from skinmap.flat.flat_map import flatten
    from skinmap.surface.surface_mesh import SurfaceMesh

    mesh = _mesh(value, part)
    return flatten(mesh) if isinstance(mesh, SurfaceMesh) else mesh


def _recordings(value: Any, _: str | None) -> list[Recording] | Any:
    from skinmap.io.recordings.touch_files import load_recordings

    files: Sequence[Any] = [value] if isinstance(value, str | Path) else value
    if not isinstance(files, list | tuple):
        return value
    if not files or not all(isinstance(one, str | Path) for one in files):
        return value
    return [one for file in files for one in load_recordings(file)]


def _classifier(value: Any, _: str | None) -> Classifier | Any:
    from skinmap.recognition.model_file import load_classifier

    return load_classifier(value) if isinstance(value, str | Path) else value


MAKERS: dict[str, Callable[[Any, str | None], Any]] = {
    "Robot": _robot,
    "SurfaceMesh": _mesh,
    "FlatMap": _flat,
    "Skin": _skin,
    "Recording": _recordings,
    "Classifier": _classifier,
}
PARTED = {"Skin", "SurfaceMesh", "FlatMap"}
