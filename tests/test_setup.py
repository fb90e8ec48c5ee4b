"""Set-up: what is missing, which command follows, which exit code; and what gets packaged."""

import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType

import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
APT = ["apt-get", "-o", "DPkg::Lock::Timeout=120"]
QUIET = ["env", "DEBIAN_FRONTEND=noninteractive"]


def load_script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


system_packages = load_script("system_packages")


class Machine(system_packages.Machine):  # type: ignore[misc, name-defined]
    """A pretended Debian: programs, installed packages, and what its package lists know."""

    def __init__(
        self,
        *,
        programs: Sequence[str] = ("apt-get", "sudo"),
        lacks: Sequence[str] = (),
        lists_are_new: bool = True,
        online: bool = True,
        sudo_asks: bool = False,
        may_install: bool = True,
    ) -> None:
        self.programs = programs
        self.lacks = list(lacks)
        self.lists_are_new = lists_are_new
        self.online = online
        self.sudo_asks = sudo_asks
        self.may_install = may_install
        self.commands: list[list[str]] = []

    def find(self, program: str) -> str | None:
        return f"/usr/bin/{program}" if program in self.programs else None

    def missing(self, *, with_uv: bool) -> list[str]:
        return [name for name in self.lacks if not (with_uv and name.endswith("-venv"))]

    def run(self, command: Sequence[str]) -> bool:
        self.commands.append(list(command))
        if list(command) == ["sudo", "-n", "true"]:
            return not self.sudo_asks
        if "update" in command:
            self.lists_are_new = self.lists_are_new or self.online
            return self.online
        if not (self.lists_are_new and self.online):
            return False
        self.lacks = [name for name in self.lacks if name not in command]
        return True

    def check(self, *arguments: str, user: int = 0) -> int:
        self.user = user
        code = system_packages.main(arguments, self)
        assert isinstance(code, int)
        return code


def test_missing_packages_names_the_package_of_each_library(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    absent = {"libGL.so.1", "libusb-1.0.so.0"}
    monkeypatch.setattr(system_packages, "library_loads", lambda name: name not in absent)
    found = system_packages.Machine().missing(with_uv=True)
    assert found == ["libgl1", "libusb-1.0-0"]


@pytest.mark.parametrize(("with_uv", "count"), [(False, 1), (True, 0)])
def test_missing_packages_needs_venv_only_without_uv(
    with_uv: bool, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(system_packages, "library_loads", lambda _name: True)
    monkeypatch.setattr(system_packages.importlib.util, "find_spec", lambda _name: None)
    found = system_packages.Machine().missing(with_uv=with_uv)
    assert len(found) == count
    assert all(re.fullmatch(r"python3\.\d+-venv", name) for name in found)


def test_library_loads_tells_present_from_absent() -> None:
    assert system_packages.library_loads("libc.so.6")
    assert not system_packages.library_loads("libnosuch.so.0")


def test_main_does_nothing_where_nothing_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    machine = Machine()
    assert machine.check() == 0
    assert machine.commands == []
    assert capsys.readouterr() == ("", "")


def test_main_installs_as_root_without_sudo() -> None:
    machine = Machine(programs=["apt-get"], lacks=["libgl1", "libegl1"])
    assert machine.check() == 0
    install = [*QUIET, *APT, "install", "-y", "--no-install-recommends", "libgl1", "libegl1"]
    assert machine.commands == [install]


def test_main_renews_the_package_lists_of_a_fresh_image() -> None:
    machine = Machine(lacks=["libgl1"], lists_are_new=False)
    assert machine.check() == 0
    assert [("update" in c, "install" in c) for c in machine.commands] == [
        (False, True),
        (True, False),
        (False, True),
    ]


def test_main_installs_through_sudo_that_does_not_ask() -> None:
    machine = Machine(lacks=["libgl1"])
    assert machine.check(user=1000) == 0
    assert machine.commands[1][:4] == ["sudo", "-n", *QUIET]


@pytest.mark.parametrize(
    ("machine", "user", "line"),
    [
        (
            Machine(lacks=["libgl1", "python3.11-venv"], sudo_asks=True),
            1000,
            "sudo apt-get update && sudo apt-get install -y libgl1 python3.11-venv",
        ),
        (
            Machine(programs=["apt-get"], lacks=["libgl1"]),
            1000,
            "sudo apt-get update && sudo apt-get install -y libgl1",
        ),
        (
            Machine(lacks=["libgl1"], lists_are_new=False, online=False),
            0,
            "apt-get update && apt-get install -y libgl1",
        ),
        (Machine(programs=[], lacks=["libgl1"]), 0, "missing system packages"),
        (
            Machine(lacks=["libgl1"], may_install=False),
            0,
            "apt-get update && apt-get install -y libgl1",
        ),
    ],
    ids=["sudo asks", "no sudo", "offline", "no apt", "INSTALL=0"],
)
def test_main_prints_one_line_and_stops_where_it_may_not_install(
    machine: Machine, user: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    lacking = list(machine.lacks)
    assert machine.check(user=user) == 2
    assert machine.lacks == lacking
    out, err = capsys.readouterr()
    assert out == ""
    last = err.splitlines()[-1]
    assert line in last
    assert all(name in last for name in lacking)


class Stubborn(Machine):
    def missing(self, *, with_uv: bool) -> list[str]:
        return ["libgl1"]


def test_main_stops_where_an_installed_package_still_does_not_load() -> None:
    assert Stubborn().check() == 2


def test_packages_are_named_before_they_are_installed(capsys: pytest.CaptureFixture[str]) -> None:
    said: list[str] = []

    class Listens(Machine):
        def run(self, command: Sequence[str]) -> bool:
            said.append(capsys.readouterr().err)
            return super().run(command)

    assert Listens(programs=["apt-get"], lacks=["libgl1", "libegl1"]).check() == 0
    assert said == ["Installing system packages: libgl1 libegl1 (INSTALL=0 only prints the line)\n"]


@pytest.mark.parametrize("arguments", [(), ("--browser",)])
def test_install_0_runs_nothing(arguments: tuple[str, ...]) -> None:
    machine = Machine(lacks=["libgl1"], may_install=False)
    machine.check(*arguments)
    assert machine.commands == []


@pytest.mark.parametrize(("value", "expected"), [("0", "False"), ("1", "True"), ("", "True")])
def test_install_comes_from_the_environment(value: str, expected: str) -> None:
    code = "import system_packages; print(system_packages.Machine.may_install)"
    environment = {**os.environ, "INSTALL": value}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT / "scripts",
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == expected


def test_browser_is_installed_for_tests_where_allowed() -> None:
    machine = Machine(programs=["apt-get"])
    assert machine.check("--browser") == 0
    assert machine.commands == [
        [*QUIET, *APT, "install", "-y", "--no-install-recommends", "chromium"]
    ]


@pytest.mark.parametrize("name", ["chromium", "chromium-browser"])
def test_browser_that_is_there_is_enough(name: str) -> None:
    machine = Machine(programs=["apt-get", name])
    assert machine.check("--browser") == 0
    assert machine.commands == []


def test_browser_that_cannot_be_had_is_told_and_no_fault(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert Machine(programs=[]).check("--browser") == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "not tested in a browser" in line
    assert "chromium" in line


def test_package_list_is_what_the_folders_hold() -> None:
    """A folder forgotten in the list would be missing from the wheel only."""
    tops = ("skinmap", "calibration", "viewer")
    folders = {
        ".".join(file.parent.relative_to(ROOT).parts)
        for top in tops
        for file in (ROOT / top).rglob("__init__.py")
    }
    listed = set(PYPROJECT["tool"]["setuptools"]["packages"])
    mapped = set(PYPROJECT["tool"]["setuptools"]["package-dir"])
    assert listed - mapped == folders


def test_packaged_data_are_there() -> None:
    """Every pattern of package-data finds a file, so that none was renamed away from it."""
    tables = PYPROJECT["tool"]["setuptools"]
    for package, patterns in tables["package-data"].items():
        folder = ROOT / tables["package-dir"].get(package, package.replace(".", "/"))
        for pattern in patterns:
            assert any(folder.glob(pattern)), f"{package}: nothing matches {pattern!r}"


def test_constraints_are_bare_versions() -> None:
    """No address, no path, no hash: anyone may install from wherever they like."""
    first, *pins = (ROOT / "constraints.txt").read_text().splitlines()
    assert first.startswith("# ")
    assert pins
    for pin in pins:
        assert re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", pin), pin


def test_constraints_pin_every_direct_dependency() -> None:
    project = PYPROJECT["project"]
    extras = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(line for extra in extras for line in extra)]
    names = {re.split(r"[<>=!~ ;\[]", line)[0].lower() for line in wanted}
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines()}
    assert names - {"skinmap"} <= pinned  # it names its own extras


def test_pinned_versions_run_on_the_oldest_python_that_we_promise() -> None:
    """What is pinned on a newer machine must install on Debian 12 (Python 3.11.2) too."""
    oldest = PYPROJECT["project"]["requires-python"].removeprefix(">=") + ".0"
    for pin in (ROOT / "constraints.txt").read_text().splitlines()[1:]:
        name, _, version = pin.partition("==")
        try:
            found = distribution(name)
        except PackageNotFoundError:
            continue  # of an extra that is not here
        asked = found.metadata.get("Requires-Python") or ""
        if found.version == version:
            assert oldest in SpecifierSet(asked), f"{pin} asks for Python {asked}"
