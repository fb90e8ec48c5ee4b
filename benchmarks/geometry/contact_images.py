"""Contact images: time a sample, against scipy's interpolator and the bandwidth of the memory.

`python -m benchmarks.geometry.contact_images` prints the rows; `contact_image_rows` gives them to
benchmarks/geometry/geometry.py. CPU time of one thread, medians, the peers interleaved.
"""

from __future__ import annotations

import json
import warnings

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from benchmarks.harness.timing import medians, ratio_quartiles, spreads, take_turns
from skinmap.flat.flat_map import FlatMap, flatten
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.surface.surface_mesh import build_surface
from skinmap.touch.contact_image import ContactImageGeometry, compiled_gathers, image_geometry
from skinmap.touch.paper_image import paper_images

BATCH = 64
ROUNDS = 7
CASES = ((768, (66, 100), 400), (10_000, (512, 512), 20))


def lattice(n: int, aspect: float) -> Skin:
    """N taxels of 8 mm pitch, hexagonal, round most of a cylinder; `aspect` as wide as high."""
    columns = round((n * aspect * np.sqrt(3) / 2) ** 0.5)
    row, column = np.divmod(np.arange(n), columns)
    across, along = 8e-3 * (column + 0.5 * (row % 2)), 8e-3 * row * np.sqrt(3) / 2
    radius = across.max() / (1.6 * np.pi)  # open at the back, its axis longer than its width
    angle = across / radius
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    positions = normals * radius + np.column_stack([np.zeros((n, 2)), along])
    return skin_from_points(positions, normals, part="lattice")


def traffic(geometry: ContactImageGeometry) -> int:
    """Bytes that one image must move: the stored geometry, the pressures and the image."""
    stored = (geometry.pixels, geometry.columns, geometry.weights)
    return sum(array.nbytes for array in stored) + 4 * len(geometry) + 4 * geometry.mask.size


def compare(flat: FlatMap, shape: tuple[int, int], repeats: int) -> dict[str, object]:
    """One row: ours and the peers on one map and one grid."""
    rng = np.random.default_rng(0)
    geometry = image_geometry(flat, shape=shape)
    paper = image_geometry(flat)
    samples = rng.random((BATCH, len(geometry)), np.float32)
    sample = samples[0]
    values = samples.T.copy()
    rows, columns = geometry.shape
    x, y = np.meshgrid(
        geometry.corner[0] + geometry.pitch * (np.arange(columns) + 0.5),
        geometry.corner[1] - geometry.pitch * (np.arange(rows) + 0.5),
    )
    centres = np.column_stack([x.ravel(), y.ravel()])
    peer = LinearNDInterpolator(flat.uv, sample, fill_value=0.0)
    triangulation = peer.tri
    moved = traffic(geometry)
    # Copying reads and writes: the rate at which memory of this size can be moved at best.
    source = np.ones(moved // 8, np.float32)
    target = np.empty_like(source)
    few = max(1, repeats // 20)
    turns = take_turns(
        {
            "image": (lambda: geometry.image(sample), repeats),
            "copy": (lambda: np.copyto(target, source), repeats),
            "csr": (lambda: geometry.single @ sample, repeats),
            "batch": (lambda: geometry.images(samples), few),
            "csr_batch": (lambda: geometry.single @ values, few),
            "paper": (lambda: paper_images(paper, samples[:1]), few),
            "paper_batch": (lambda: paper_images(paper, samples), few),
            "peer_reused": (
                lambda: LinearNDInterpolator(triangulation, sample, fill_value=0.0)(centres),
                few,
            ),
            "peer_rebuilt": (
                lambda: LinearNDInterpolator(flat.uv, sample, fill_value=0.0)(centres),
                1,
            ),
        },
        ROUNDS,
    )
    times = medians(turns, 1e6)
    ratios = ratio_quartiles(turns, {"times_bandwidth_bound": ("image", "copy")})
    theirs = LinearNDInterpolator(triangulation, sample, fill_value=0.0)(centres)
    both = geometry.mask.ravel()
    error = np.abs(theirs - geometry.image(sample).ravel())[both]
    return {
        "taxels": len(geometry),
        "shape": list(geometry.shape),
        "pixels_in_the_map": len(geometry.pixels),
        "compiled": compiled_gathers() is not None,
        "quartiles_us": spreads(turns, 1e6),
        "image_us": times["image"],
        "batch_us_per_sample": times["batch"] / BATCH,
        "csr_us": times["csr"],
        "csr_batch_us_per_sample": times["csr_batch"] / BATCH,
        "bandwidth_bound_us": times["copy"],
        "bytes": moved,
        "gigabytes_per_second": moved / times["copy"] * 1e-3,
        "times_bandwidth_bound": ratios["times_bandwidth_bound"][1],
        "ratio_quartiles": ratios,
        "batch_quartiles_us_per_sample": spreads(turns, 1e6 / BATCH)["batch"],
        "paper_image_us": times["paper"],
        "paper_batch_us_per_sample": times["paper_batch"] / BATCH,
        "scipy_rebuilt_us": times["peer_rebuilt"],
        "scipy_reused_us": times["peer_reused"],
        "times_faster_than_scipy_reused": times["peer_reused"] / times["image"],
        # Where scipy's Delaunay has the same triangles as the map: all but slivers at the border.
        "pixels_equal_to_scipy_percent": 100.0 * float((error < 1e-5).mean()),
    }


def contact_image_rows() -> list[dict[str, object]]:
    """66 x 100 from 768 taxels, 512 x 512 from 10,000."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [
            compare(flatten(build_surface(lattice(n, shape[1] / shape[0]))), shape, repeats)
            for n, shape, repeats in CASES
        ]


if __name__ == "__main__":
    print(json.dumps(contact_image_rows(), indent=2))
