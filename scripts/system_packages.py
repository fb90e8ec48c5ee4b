"""Find the system packages that are missing, and install them where that is allowed.

Runs before any environment exists: standard library only. Exit code 0 when all is there,
2 after printing the one line to type.
"""

import argparse
import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence

# Debian package of each shared library that the Python wheels do not bring along.
LIBRARIES = {
    "libGL.so.1": "libgl1",  # vtk: crashes without a word where it is missing
    "libEGL.so.1": "libegl1",  # vtk: pictures without a screen
    "libOpenGL.so.0": "libopengl0",  # pymeshlab's plugins
    "libusb-1.0.so.0": "libusb-1.0-0",  # open3d
    "libgomp.so.1": "libgomp1",  # scikit-learn, open3d
}

# For `make test` only: 100 MB that nobody needs who wants to see the demo.
BROWSERS = ["chromium", "chromium-browser"]


def library_loads(name: str) -> bool:
    """Whether the dynamic linker finds the library and all that it needs itself."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def has_ensurepip() -> bool:
    """Whether this Python can make an environment with pip; Debian ships that part apart."""
    return importlib.util.find_spec("ensurepip") is not None


def missing_packages(
    *,
    with_uv: bool,
    loads: Callable[[str], bool] = library_loads,
    ensurepip: Callable[[], bool] = has_ensurepip,
) -> list[str]:
    """Debian packages to install, in the order of the table."""
    packages = [package for library, package in LIBRARIES.items() if not loads(library)]
    if not with_uv and not ensurepip():
        packages.append(f"python{sys.version_info.major}.{sys.version_info.minor}-venv")
    return packages


def run_quietly(command: Sequence[str]) -> bool:
    """Run a command without its output and without questions; whether it succeeded."""
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    return done.returncode == 0


def apt_prefix(
    *,
    user: int,
    find: Callable[[str], str | None] = shutil.which,
    run: Callable[[Sequence[str]], bool] = run_quietly,
) -> list[str] | None:
    """What to write before ``apt-get`` to install without a question; None where not allowed."""
    if find("apt-get") is None:
        return None
    quiet = ["env", "DEBIAN_FRONTEND=noninteractive"]
    if user == 0:
        return quiet
    if find("sudo") is not None and run(["sudo", "-n", "true"]):
        return ["sudo", "-n", *quiet]
    return None


def install(
    packages: Sequence[str],
    prefix: Sequence[str],
    *,
    run: Callable[[Sequence[str]], bool] = run_quietly,
) -> bool:
    """Install through apt-get; a second try with new package lists (a fresh image has none)."""
    # The time-out waits for another apt that is at work, as on a machine just started.
    apt = [*prefix, "apt-get", "-o", "DPkg::Lock::Timeout=120"]
    command = [*apt, "install", "-y", "--no-install-recommends", *packages]
    return run(command) or (run([*apt, "update"]) and run(command))


def add_browser(
    *, user: int, find: Callable[[str], str | None], run: Callable[[Sequence[str]], bool]
) -> int:
    """Install the browser that tests look at the viewer's page with; tests skip without it."""
    if any(find(name) is not None for name in BROWSERS):
        return 0
    prefix = apt_prefix(user=user, find=find, run=run)
    if prefix is not None:
        print(f"Installing {BROWSERS[0]} for the tests of the page ...", file=sys.stderr)
        if install(BROWSERS[:1], prefix, run=run):
            return 0
    print(f"No {BROWSERS[0]} here: tests of the page in a browser are skipped", file=sys.stderr)
    return 0


def line_to_type(packages: Sequence[str], *, user: int, has_apt: bool) -> str:
    """The line that tells a person how to go on."""
    names = " ".join(packages)
    if not has_apt:
        return f"Missing system packages (Debian's names): {names}"
    sudo = "" if user == 0 else "sudo "
    return (
        "Missing system packages. Please type: "
        f"{sudo}apt-get update && {sudo}apt-get install -y {names}"
    )


def main(
    arguments: Sequence[str] | None = None,
    *,
    missing: Callable[..., list[str]] = missing_packages,
    user: int | None = None,
    find: Callable[[str], str | None] = shutil.which,
    run: Callable[[Sequence[str]], bool] = run_quietly,
) -> int:
    """Check, install where allowed, check again."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uv", action="store_true", help="uv makes the environment, not venv")
    parser.add_argument("--browser", action="store_true", help="only the browser for tests")
    options = parser.parse_args(arguments)
    with_uv = options.uv
    user = os.geteuid() if user is None else user
    if options.browser:
        return add_browser(user=user, find=find, run=run)

    packages = missing(with_uv=with_uv)
    if not packages:
        return 0
    prefix = apt_prefix(user=user, find=find, run=run)
    if prefix is not None:
        print(f"Installing system packages: {' '.join(packages)} ...", file=sys.stderr)
        if install(packages, prefix, run=run):
            packages = missing(with_uv=with_uv)
        if not packages:
            return 0
    print(line_to_type(packages, user=user, has_apt=find("apt-get") is not None), file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
