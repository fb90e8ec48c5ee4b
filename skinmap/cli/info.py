"""`skinmap info`: a recording, or the installation."""

from __future__ import annotations

import os
import platform
import re
import socket
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import distribution, version
from pathlib import Path

import click

from skinmap.commands.options import PATH, open_robot, played_robot_option, prints
from skinmap.display import has_display, window_class
from skinmap.display import loads as loads_library
from skinmap.errors import MissingLibraryError
from skinmap.imports import installed
from skinmap.report.present import present
from skinmap.report.table import Table


@dataclass(frozen=True, kw_only=True, slots=True)
class CacheInfo:
    """Results kept between runs.

    Attributes
    ----------
    folder
        Where; null where the cache is off.
    state
        "ready", "empty", "read-only", "off", or why it cannot be used.
    limit_mb, used_mb
        The most that is kept, and what is.
    entries
        Number of cache entries.
    """

    folder: str | None
    state: str
    limit_mb: float = 0.0
    used_mb: float = 0.0
    entries: int = 0


def cache_info() -> CacheInfo:
    """Look into the cache."""
    from skinmap.disk_cache import open_cache

    cache = open_cache()
    if cache is None:
        return CacheInfo(folder=None, state="off")
    entries = cache.entries()
    state = "ready"
    if not cache.folder.exists():
        state = "empty"
    elif not cache.folder.is_dir():
        state = "unusable: not a folder"
    elif not os.access(cache.folder, os.W_OK):
        state = "read-only"
    return CacheInfo(
        folder=str(cache.folder),
        state=state,
        limit_mb=cache.limit / 1e6,
        used_mb=sum(entry.size for entry in entries) / 1e6,
        entries=len(entries),
    )


CORE = ("numpy", "scipy", "scikit-learn", "trimesh", "libigl", "pymeshlab", "pyvista", "vtk",
        "matplotlib", "mcap", "pylsl", "pyzmq", "websockets")  # fmt: skip
PORTS = {8080: "view --web", 8765: "--publish foxglove", 7447: "zenoh:"}
PURPOSES = {
    "scan": "registration of scans",
    "mujoco": "touches pressed by MuJoCo",
    "fast": "compiled loops",
    "dask": "work on a cluster",
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
        packages={name: installed(name) for name in CORE},
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
    packages = {package: installed(package) for package in _packages(name)}
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


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedSkin:
    """The recorded skin, as described in the file.

    Attributes
    ----------
    robot
        Name of the robot; empty where the file has none.
    parts
        In the order of the channels.
    taxels
        Over all parts; null where the file has no table of them.
    fingerprints
        By part, where known.
    """

    robot: str
    parts: list[str]
    taxels: int | None
    fingerprints: dict[str, str]


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordingInfo:
    """Content of a recording.

    Attributes
    ----------
    samples
        Of the whole recording.
    seconds
        From the first sample to the last.
    channels
        Values in a sample.
    rate_hz
        Samples a second; null for fewer than two.
    gaps
        Steps above 1.5 times the median; null where no rate is known and steps vary.
    recovered
        Whether the file was cut off or damaged.
    lost_seconds
        Duration of samples that could not be recovered.
    skin
        The skin of the recording.
    """

    samples: int
    seconds: float
    channels: int
    rate_hz: float | None
    gaps: int | None
    recovered: bool
    lost_seconds: float
    skin: RecordedSkin


@click.command("info")
@click.argument("recording", required=False, type=PATH)
@played_robot_option
@prints(RecordingInfo, InstallationInfo)
def command(recording: Path | None, robot: str | None, as_json: bool) -> None:
    """Describe a recording, or the installation.

    RECORDING is MCAP, our .npz, XDF, a data.log or a folder of them: its samples, rate, gaps, skin,
    and the time lost if it was cut off. A damaged file is read as far as possible.

    Without RECORDING: versions, extras and how to install them, display, OpenGL and the cache.

    \b
    Example:  skinmap info touch.mcap --json
    """
    if recording is None:
        if robot is not None:
            raise click.UsageError("--robot needs a RECORDING to check")
        present(installation(), lines, as_json=as_json)
        return
    result, touches, damage = work(recording, robot)
    present(result, lambda info: _lines(info, touches, damage), as_json=as_json)


def work(path: Path, robot: str | None) -> tuple[RecordingInfo, Counter[str], list[str]]:
    """What is in the file, its touches by label, and what is wrong with it in words."""
    from skinmap.live.sources.open_source import open_track
    from skinmap.live.sources.source import check_skin

    loaded = open_robot(robot, ())[0] if robot else None
    track = open_track(path, robot=loaded)
    if loaded is not None:
        check_skin(track.info, loaded)
    skin = RecordedSkin(
        robot=track.info.robot or track.manifest,
        parts=list(track.info.parts),
        taxels=sum(len(table) for table in track.tables.values()) or None,
        fingerprints=dict(track.info.fingerprints),
    )
    result = RecordingInfo(
        samples=len(track.times),
        seconds=track.seconds,
        channels=track.info.channels,
        rate_hz=track.info.rate,
        gaps=track.gaps,
        recovered=track.loss.recovered,
        lost_seconds=track.loss.seconds,
        skin=skin,
    )
    return result, Counter(touch.label for touch in track.touches), list(track.loss.damage)


def _lines(info: RecordingInfo, touches: Counter[str], damage: list[str]) -> Iterator[str]:
    rate = float("nan") if info.rate_hz is None else info.rate_hz
    apart = f", {info.samples / rate:.1f} s of samples" if info.gaps else ""
    gaps = "irregular" if info.gaps is None else f"{info.gaps} gap{'s' * (info.gaps != 1)}"
    yield (
        f"{info.samples} samples of {info.channels} channels{apart} in {info.seconds:.2f} s "
        f"({rate:.4g} a second), {gaps}"
    )
    taxels = f", {info.skin.taxels} taxels" if info.skin.taxels else ""
    yield f"{info.skin.robot or 'robot unknown'}: {', '.join(info.skin.parts)}{taxels}"
    for label, count in sorted(touches.items()):
        yield f"{count} touches marked {label!r}"
    if info.recovered:
        yield f"recovered; {info.lost_seconds:.2f} s lost: {'; '.join(damage)}"
