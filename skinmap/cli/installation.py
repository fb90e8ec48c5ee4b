"""`skinmap info` without a recording: versions, extras, display, cache, and what is missing."""

from __future__ import annotations

import platform
import re
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution, metadata, version

from skinmap.cli.cache import CacheInfo, cache_info
from skinmap.display import has_display, window_class
from skinmap.display import loads as loads_library
from skinmap.errors import MissingLibraryError
from skinmap.report.table import Table

CORE = ("numpy", "scipy", "scikit-learn", "trimesh", "libigl", "pymeshlab", "pyvista", "vtk",
        "matplotlib", "mcap", "pylsl", "pyzmq", "websockets")  # fmt: skip
PORTS = {8080: "view --web", 8765: "--publish foxglove", 7447: "zenoh:"}
PURPOSES = {
    "scan": "registration of scans",
    "mujoco": "touches pressed by MuJoCo",
    "fast": "compiled loops",
    "dask": "work on a cluster",
    "notebook": "the scene in Jupyter",
    "images": "bags of visual words",
    "foxglove": "streams to Foxglove",
    "zenoh": "streams from and to ROS 2",
    "lerobot": "LeRobot data sets",
    "hdf5": "arrays as .h5",
    "movies": "movies as .mp4",
    "rerun": "files for rerun",
    "torch": "training of networks",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Extra:
    """An optional part of the installation.

    Attributes
    ----------
    name
        Name of the extra in `pip install 'skinmap[NAME]'`.
    purpose
        Features that need it.
    packages
        Packages it brings; their versions where they are installed, null elsewhere.
    installed
        Whether all of them are there.
    """

    name: str
    purpose: str
    packages: dict[str, str | None]
    installed: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class InstallationInfo:
    """The installation and the machine.

    Attributes
    ----------
    skinmap, python, system
        Versions and the operating system.
    packages
        Versions of the packages that every installation has; null where one is missing.
    extras
        Optional parts of the installation.
    ports
        Default ports of this machine by number, and whether each is free.
    display
        Whether a window can be opened.
    opengl
        Library class that draws pictures; "default" for VTK's own choice, null where none is found.
    cache
        Files kept between runs.
    """

    skinmap: str
    python: str
    system: str
    packages: dict[str, str | None]
    extras: list[Extra]
    ports: dict[str, bool]
    display: bool
    opengl: str | None
    cache: CacheInfo


def installation() -> InstallationInfo:
    """Look at the installation; nothing heavy is imported."""
    display = has_display()
    try:
        opengl: str | None = window_class(not display, loads_library) or "default"
    except MissingLibraryError:
        opengl = None
    return InstallationInfo(
        skinmap=version("skinmap"),
        python=platform.python_version(),
        system=platform.platform(terse=True),
        packages={name: _version(name) for name in CORE},
        extras=[_extra(name, purpose) for name, purpose in PURPOSES.items() if _packages(name)],
        ports={str(port): _free(port) for port in PORTS},
        display=display,
        opengl=opengl,
        cache=cache_info(),
    )


def _packages(extra: str) -> list[str]:
    """Packages of an extra, without their versions."""
    asked = distribution("skinmap").requires or []
    mine = [one for one in asked if re.search(rf"extra == ['\"]{extra}['\"]", one)]
    return [re.split(r"[^\w.-]", one, maxsplit=1)[0] for one in mine]


def _extra(name: str, purpose: str) -> Extra:
    packages = {package: _version(package) for package in _packages(name)}
    return Extra(
        name=name, purpose=purpose, packages=packages, installed=None not in packages.values()
    )


def _free(port: int) -> bool:
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the servers do
        try:
            one.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _version(package: str) -> str | None:
    try:
        return metadata(package)["Version"]
    except PackageNotFoundError:
        return None


def lines(info: InstallationInfo) -> Iterator[str | Table]:
    """Words for people; each missing thing with the line that installs it."""
    yield f"skinmap {info.skinmap}, Python {info.python}, {info.system}"
    yield ", ".join(f"{name} {found or 'missing'}" for name, found in info.packages.items())
    rows = [
        [one.name, one.purpose, "yes" if one.installed else f"pip install 'skinmap[{one.name}]'"]
        for one in info.extras
    ]
    yield Table(["extra", "for", "installed"], rows)
    states = [f"{port} ({PORTS[int(port)]}) {'free' if free else 'in use'}"
              for port, free in info.ports.items()]  # fmt: skip
    yield f"ports: {', '.join(states)}"
    yield f"display: {'yes' if info.display else 'none; pictures, movies and --web work without'}"
    yield f"OpenGL: {info.opengl or 'none; on Debian or Ubuntu: apt-get install -y libgl1 libegl1'}"
    cache = info.cache
    yield f"cache: {cache.state}, {cache.used_mb:.1f} of {cache.limit_mb:.0f} MB" + (
        f" in {cache.folder}" if cache.folder else ""
    )
