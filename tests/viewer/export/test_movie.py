import resource
import subprocess

import imageio_ffmpeg
import numpy as np
import pytest

import viewer.view_files
from skinmap.errors import InvalidArrayError, OutputError, SkinWarning
from viewer import write_movie


def pictures(count, size=(64, 80)):
    for k in range(count):
        picture = np.full((*size, 3), 255, np.uint8)
        picture[:, : 2 + 3 * k] = (20, 90, 180)
        yield picture


def read_movie(path, size):
    """All pictures of a movie, decoded by ffmpeg itself: imageio's reader leaves pipes open."""
    program = imageio_ffmpeg.get_ffmpeg_exe()
    command = [program, "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    answer = subprocess.run(command, capture_output=True, check=True)
    return np.frombuffer(answer.stdout, np.uint8).reshape(-1, *size, 3)


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_write_movie_holds_every_picture(tmp_path, name):
    path = write_movie(tmp_path / name, pictures(12), 25)
    film = read_movie(path, (64, 80))
    assert film.shape == (12, 64, 80, 3)
    # The bar grows: each picture is where it belongs. Compression blurs the edge, not the order.
    dark = (film[..., 0] < 128).sum(axis=(1, 2))
    assert (np.diff(dark.astype(int)) > 0).all()
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_write_movie_cuts_odd_sizes_to_even(tmp_path):
    path = write_movie(tmp_path / "odd.mp4", pictures(3, (65, 81)), 25)
    assert len(read_movie(path, (64, 80))) == 3


def test_write_movie_without_ffmpeg_is_a_gif(tmp_path, monkeypatch):
    monkeypatch.setattr(viewer.view_files, "find_ffmpeg", lambda: None)
    with pytest.warns(SkinWarning, match=r"film.gif instead; for .mp4: pip install"):
        path = write_movie(tmp_path / "film.mp4", pictures(3), 25)
    assert path == tmp_path / "film.gif"
    assert [file.name for file in tmp_path.iterdir()] == ["film.gif"]


def test_write_movie_that_fails_midway_leaves_nothing(tmp_path):
    def broken():
        yield from pictures(2)
        raise RuntimeError("the source is gone")

    with pytest.raises(RuntimeError, match="gone"):
        write_movie(tmp_path / "film.mp4", broken(), 25)
    with pytest.raises(InvalidArrayError, match="at least one picture"):
        write_movie(tmp_path / "film.gif", iter(()), 25)
    assert list(tmp_path.iterdir()) == []


def test_write_movie_into_a_missing_folder_says_so(tmp_path):
    with pytest.raises(OutputError, match="none"):
        write_movie(tmp_path / "none" / "film.mp4", pictures(2), 25)


@pytest.mark.parametrize(
    ("name", "frames"), [("film.mp4", 12), ("film.mp4", 400), ("film.gif", 12)]
)
def test_a_movie_that_a_full_disk_cuts_is_one_line_and_no_file(tmp_path, rng, name, frames):
    """ffmpeg's own exit code is seen by nobody: the file's boxes are counted."""
    noise = rng.integers(0, 255, (64, 80, 3), np.uint8)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600, before[1]))
    try:
        with pytest.raises(OutputError, match=r"cannot write '.*film\.[a-z0-9]{3}': "):
            write_movie(tmp_path / name, (np.roll(noise, k, 1) for k in range(frames)), 25)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
