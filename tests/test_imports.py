"""Modules that run at their first use: the same modules, only later."""

from __future__ import annotations

import subprocess
import sys

import pytest

BEGIN = "import sys; from skinmap.imports import run_late; run_late(); run_late()\n"


def child(code):
    """What a fresh process prints."""
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + code], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_importing_runs_nothing_and_using_runs_all():
    code = """
import scipy.stats, sklearn.base
print("scipy.stats._stats_py" in sys.modules)
print(scipy.stats.norm.cdf(0.0), "scipy.stats._stats_py" in sys.modules)
print(type(scipy.stats).__name__, scipy.stats.__file__.endswith("__init__.py"))
"""
    assert child(code) == ["False", "0.5", "True", "module", "True"]


@pytest.mark.parametrize(
    "use",
    [
        "from scipy.stats import norm",
        "import scipy.stats.distributions; norm = scipy.stats.norm",
        "from scipy.stats.distributions import norm",
        "import scipy; norm = scipy.stats.norm",
        "import pickle; norm = pickle.loads(b'cscipy.stats\\nnorm\\n.')",
    ],
)
def test_every_way_to_import_ends_in_the_same_module(use):
    assert child(f"{use}\nprint(norm.cdf(0.0), sys.modules['scipy.stats'].norm is norm)") == [
        "0.5",
        "True",
    ]


def test_what_does_not_exist_is_missing_as_always():
    code = """
import matplotlib.pyplot as plt
try:
    plt.nothing
except AttributeError as error:
    print("'matplotlib.pyplot'" in str(error))
try:
    from matplotlib.pyplot import nothing
except ImportError:
    print("ImportError")
"""
    assert child(code) == ["True", "ImportError"]


def test_threads_that_use_one_at_once_find_it_whole():
    code = """
import threading
import numpy.testing
found = []
look = lambda: found.append(numpy.testing.assert_allclose)
threads = [threading.Thread(target=look) for _ in range(8)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
print(len(found), len({id(one) for one in found}))
"""
    assert child(code) == ["8", "1"]
