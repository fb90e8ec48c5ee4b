"""Model files (`.skinmodel`): JSON, arrays and a skops estimator in a zip, nothing executable.

| file in the zip | what it holds |
|---|---|
| `model.json` | format, versions, classifier, labels, the skins trained on with fingerprints |
| `skins.npz` | taxel positions [m] of those skins |
| `descriptor.npz` | what the descriptor learnt (`to_arrays`): a codebook, say |
| `estimator.npz` | the estimator as its own arrays (`to_arrays`), where it has them |
| `estimator.skops` | any other scikit-learn estimator, by names of known types and arrays |
| `sets.npz` | what sets of names are promised by (`prediction_sets`), where that was calibrated |
| `early.npz` | how far names of young touches are to be doubted (`rejection`) |

Nothing is unpacked to disk, unpickled or imported because a file asks for it.
"""

from __future__ import annotations

import importlib.util
import io
import json
import sys
import warnings
import zipfile
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap import __version__
from skinmap.archive import check_directory, quiet_headers
from skinmap.errors import (
    DataFormatError,
    MissingFileError,
    OutputError,
    UnknownNameError,
    check_kind,
    warn,
)
from skinmap.recognition.catalogue import classifiers
from skinmap.recognition.prediction_sets import doubt_from, set_calibration_from
from skinmap.touch.prepared_skin import TrainedSkin

if TYPE_CHECKING:
    from skinmap.recognition.classifier import TouchClassifier

FORMAT = "skinmap-model-4"
SUFFIX = ".skinmodel"
LIBRARIES = ("numpy", "scikit-learn", "skops")
HEAD, SKINS, DESCRIPTOR, ESTIMATOR = "model.json", "skins.npz", "descriptor.npz", "estimator.skops"
ARRAYS, SETS, EARLY = "estimator.npz", "sets.npz", "early.npz"
ANSWERS = "answers.npz"  # of kind, motion and hand, as `answering` reads it, too
FILES = (HEAD, SKINS, DESCRIPTOR, ARRAYS, ESTIMATOR, SETS, EARLY, ANSWERS)
LARGEST = 2**28  # bytes in a file, unpacked, and in each archive inside it
# Beside the types that skops trusts by itself; none of them can be told to call anything.
KNOWN = frozenset(
    {
        "sklearn.calibration._CalibratedClassifier",
        "sklearn.calibration._SigmoidCalibration",
        "sklearn.calibration._TemperatureScaling",
        # a grid search brings its folds and its table of results
        "sklearn.metrics._scorer._PassthroughScorer",
        "sklearn.model_selection._split.StratifiedKFold",
        "numpy.ma.MaskedArray",
        "scipy.sparse._csr.csr_array",
    }
)


def save_classifier(classifier: TouchClassifier, path: str | Path) -> None:
    """Write a trained classifier.

    Parameters
    ----------
    classifier : Classifier
        Trained.
    path : str or Path
        File to write; one that is there is replaced.

    Raises
    ------
    NotFittedError
        Before training.
    OutputError
        The file cannot be written.

    Examples
    --------
    >>> from skinmap.recognition import default_model
    >>> save_classifier(default_model(), "own.skinmodel")
    """
    trained, as_arrays = classifier.trained_on, hasattr(classifier.estimator, "to_arrays")
    head: dict[str, Any] = {
        "format": FORMAT,
        "versions": _versions(LIBRARIES[:1] if as_arrays else LIBRARIES),
        "classifier": classifier.name,
        "labels": list(classifier.labels),
        "skins": [
            {"part": one.part, "taxels": len(one.positions), "fingerprint": one.fingerprint}
            for one in trained
        ],
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:

        def add(name: str, data: str | bytes) -> None:
            # Without the time of day: the same model is the same file.
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)

        add(HEAD, json.dumps(head, indent=1))
        add(SKINS, _pack({str(i): one.positions for i, one in enumerate(trained)}))
        if hasattr(classifier.descriptor, "to_arrays"):
            add(DESCRIPTOR, _pack(classifier.descriptor.to_arrays()))
        if as_arrays:
            add(ARRAYS, _pack(classifier.estimator.to_arrays()))
        else:
            from skops.io import dumps

            add(ESTIMATOR, dumps(classifier.estimator))
        if classifier.sets is not None:
            add(SETS, _pack(classifier.sets.to_arrays()))
        if classifier.doubt is not None:
            add(EARLY, _pack({"doubt": classifier.doubt}))
        if classifier.own_answers is not None:
            add(ANSWERS, _pack(classifier.own_answers.to_arrays()))
    try:
        Path(path).write_bytes(buffer.getvalue())
    except OSError as error:
        raise OutputError(f"cannot write {str(path)!r}: {error.strerror}") from error


def load_classifier(path: str | Path) -> TouchClassifier:
    """Read a classifier; nothing in the file is executed.

    A `SkinWarning` names libraries of another version than the file was made with.

    Parameters
    ----------
    path : str or Path
        A file ending in .skinmodel.

    Returns
    -------
    Classifier
        Trained.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not a Skinmap model, or one that holds types that a model has no use for.
    UnknownNameError
        A classifier whose plug-in is not installed.

    Examples
    --------
    >>> from skinmap.recognition import default_model
    >>> save_classifier(default_model(), "own.skinmodel")
    >>> load_classifier("own.skinmodel").name
    'contact-geometry'
    """
    return read_model(Path(path), classifiers.get)


def read_model(path: Path, find: Callable[[str], Callable[[], TouchClassifier]]) -> TouchClassifier:
    """As `load_classifier`, where `find` gives a function that makes the classifier of a name."""
    if not path.is_file():
        raise MissingFileError(path, f"a model made by `skinmap train` ({SUFFIX})")
    try:
        with zipfile.ZipFile(path) as archive:
            _check_archive(archive, path, known=FILES)
            head = json.loads(archive.read(HEAD))
            if head.get("format") != FORMAT:
                raise DataFormatError(
                    f"format {head.get('format')!r}, expected {FORMAT!r}: train the model again",
                    path,
                )
            classifier = find(str(head["classifier"]))()
            if hasattr(classifier.descriptor, "from_arrays"):
                classifier.descriptor.from_arrays(_unpack(archive.read(DESCRIPTOR), path))
            if ARRAYS in archive.namelist():
                classifier.estimator.from_arrays(_unpack(archive.read(ARRAYS), path))
            else:
                classifier.estimator = _read_estimator(archive.read(ESTIMATOR), classifier, path)
            classifier.trained_on = _read_skins(head["skins"], archive.read(SKINS), path)
            if SETS in archive.namelist():
                classifier.sets = set_calibration_from(_unpack(archive.read(SETS), path))
            if EARLY in archive.namelist():
                classifier.doubt = doubt_from(_unpack(archive.read(EARLY), path)["doubt"])
            if ANSWERS in archive.namelist():
                from skinmap.recognition.answering import three_answers_from

                found = _unpack(archive.read(ANSWERS), path)
                classifier.own_answers = three_answers_from(found)
            if list(classifier.labels) != head["labels"]:
                raise DataFormatError("its labels are not those of its estimator", path)
    except (DataFormatError, UnknownNameError):
        check_kind(path, "a model")
        raise
    # A damaged file fails in zip, JSON, numpy or skops, each in its own way.
    except Exception as error:
        check_kind(path, "a model")
        again = ": train the model again" if isinstance(error, KeyError) else ""
        raise DataFormatError(f"not a Skinmap model: {error}{again}", path) from error
    _warn_of_versions(head["versions"], path)
    return classifier


def _check_archive(
    archive: zipfile.ZipFile, path: Path, *, known: tuple[str, ...] | None = None
) -> None:
    """Refuse what unpacks to too much, and files that a model has no use for.

    zipfile never reads more of a file than its entry says, so the entries can be trusted.
    """
    check_directory(archive)
    size = sum(entry.file_size for entry in archive.infolist())
    if size > LARGEST:
        raise DataFormatError(f"unpacks to {size} bytes, a model has at most {LARGEST}", path)
    strange = [name for name in archive.namelist() if known is not None and name not in known]
    if strange or len(set(archive.namelist())) != len(archive.namelist()):
        raise DataFormatError(f"refused: it holds files {archive.namelist()}", path)


def _read_estimator(data: bytes, classifier: TouchClassifier, path: Path) -> Any:
    from skops.io import get_untrusted_types, loads

    with zipfile.ZipFile(io.BytesIO(data)) as inner:
        _check_archive(inner, path)
    found = get_untrusted_types(data=data)
    foreign = foreign_types(found, classifier.estimator)
    if foreign and all(name.startswith("skinmap.classif") for name in foreign):
        raise DataFormatError("made by an earlier version: train the model again", path)
    if foreign:
        raise DataFormatError(f"refused: it holds {', '.join(foreign)}", path)
    with warnings.catch_warnings():
        from sklearn.exceptions import InconsistentVersionWarning

        warnings.simplefilter("ignore", InconsistentVersionWarning)  # our own message has one line
        estimator = loads(data, trusted=found)
    if type(estimator) is not type(classifier.estimator):
        raise DataFormatError(
            f"refused: its estimator is a {type(estimator).__name__}, "
            f"{classifier.name!r} has a {type(classifier.estimator).__name__}",
            path,
        )
    return estimator


def _read_skins(entries: list[Any], data: bytes, path: Path) -> tuple[TrainedSkin, ...]:
    arrays = _unpack(data, path)
    skins = tuple(
        TrainedSkin(str(entry["part"]), np.asarray(arrays[str(i)], np.float64).reshape(-1, 3))
        for i, entry in enumerate(entries)
    )
    for entry, skin in zip(entries, skins, strict=True):
        if entry["fingerprint"] != skin.fingerprint:
            raise DataFormatError(f"positions of {skin.part!r} do not fit their fingerprint", path)
    return skins


def _pack(arrays: dict[str, NDArray[Any]]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _unpack(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    with zipfile.ZipFile(io.BytesIO(data)) as inner:
        _check_archive(inner, path)
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays, quiet_headers():
        return dict(arrays)


def _versions(libraries: Iterable[str]) -> dict[str, str]:
    return {"skinmap": __version__, **{name: version(name) for name in libraries}}


def _warn_of_versions(made_with: dict[str, str], path: Path) -> None:
    """Major and minor versions only, as patches keep estimators, and all of NumPy its arrays."""
    now = _versions([name for name in LIBRARIES[1:] if name in made_with])
    other = [
        f"{name} {made_with.get(name, 'unknown')} (here {have})"
        for name, have in now.items()
        if str(made_with.get(name)).split(".")[:2] != have.split(".")[:2]
    ]
    if other:
        warn(f"{path}: made with {', '.join(other)}; train again if it behaves oddly", above=1)


def foreign_types(found: Iterable[str], estimator: Any) -> list[str]:
    """Types of a file that a model has no use for.

    Parameters
    ----------
    found : iterable of str
        Full names of the types that skops does not trust by itself.
    estimator : object
        What the classifier of the file's name is made with: its own types are expected.
    """
    expected = {_name(type(part)) for part in _parts(estimator)}
    return sorted(
        name for name in found if name not in KNOWN | expected and not _our_estimator(name)
    )


def _our_estimator(name: str) -> bool:
    """Whether a name is an estimator of this package; functions and other types are not."""
    from sklearn.base import BaseEstimator

    module, _, attribute = name.rpartition(".")
    if not module.startswith("skinmap.recognition."):
        return False
    if module not in sys.modules:
        if importlib.util.find_spec(module) is None:
            return False
        importlib.import_module(module)
    thing = getattr(sys.modules[module], attribute, None)
    return isinstance(thing, type) and issubclass(thing, BaseEstimator)


def _parts(estimator: Any) -> list[Any]:
    """An estimator and those it is made with."""
    if not hasattr(estimator, "get_params"):
        return [estimator]
    inner = estimator.get_params(deep=True).values()
    return [estimator, *(part for part in inner if hasattr(part, "fit"))]


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
