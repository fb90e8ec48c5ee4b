from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, NotFittedError, UnknownNameError
from skinmap.recognition.images import cnn as module
from skinmap.recognition.images.cnn import RECIPES, ContactImageCNN, Recipe


@pytest.fixture
def bars(rng) -> tuple[np.ndarray, np.ndarray]:
    """120 images of 66 x 100 with a bar that lies or stands, anywhere."""
    images, labels = np.zeros((120, 66, 100), np.uint8), np.tile(["lying", "standing"], 60)
    for image, label in zip(images, labels, strict=True):
        row, column = rng.integers(20, 46), rng.integers(20, 80)
        half = (4, 16) if label == "lying" else (16, 4)
        image[row - half[0] : row + half[0], column - half[1] : column + half[1]] = 255
    return images.reshape(120, -1), labels


def recipe(**changes) -> Recipe:
    values = {"channels": 8, "shrink": 1, "epochs": 30, "batch": 32}
    values |= {"learning_rate": 0.1, "schedule": "constant", "mirror": True, "shift": 0}
    return Recipe(**(values | changes))


def test_learning_rate_schedules():
    assert {recipe().rate(epoch) for epoch in range(30)} == {0.1}
    step = [recipe(schedule="step").rate(epoch) for epoch in range(30)]
    np.testing.assert_allclose(step, [0.1] * 20 + [0.01] * 10)
    cosine = np.array([recipe(schedule="cosine").rate(epoch) for epoch in range(30)])
    assert cosine[0] == pytest.approx(0.02)  # grows over five epochs
    assert cosine[15] == pytest.approx(0.05)
    assert cosine.argmax() == 4
    assert (np.diff(cosine[4:]) < 0).all()
    with pytest.raises(InvalidArrayError, match="no schedule 'slow'; the schedules are: constant"):
        recipe(schedule="slow").rate(0)


@pytest.mark.parametrize(
    "bad", [{"epochs": 0}, {"batch": 0}, {"shift": -1}, {"learning_rate": 0.0}]
)
def test_recipes_that_train_nothing_are_refused(bad):
    with pytest.raises(InvalidArrayError, match="must be at least 1"):
        recipe(**bad)


def test_fit_learns_bars_and_repeats_itself(bars):
    pytest.importorskip("torch", reason="the extra `torch` is not installed")
    images, labels = bars
    machine = ContactImageCNN(epochs=8, schedule="constant", mirror=False, shift=0)
    machine.fit(images[:90], labels[:90])
    assert machine.score(images[90:], labels[90:]) >= 0.9
    share = machine.predict_proba(images[90:])
    np.testing.assert_allclose(share.sum(axis=1), 1.0, atol=1e-12)
    again = ContactImageCNN(epochs=8, schedule="constant", mirror=False, shift=0)
    again.fit(images[:90], labels[:90])
    np.testing.assert_array_equal(again.predict_proba(images[90:]), share)


def test_a_net_that_stays_at_chance_is_trained_again(bars, monkeypatch):
    torch = pytest.importorskip("torch", reason="the extra `torch` is not installed")

    build, made = module._build, []

    def dead_first(*arguments):
        net = build(*arguments)
        if not made:
            torch.nn.init.constant_(net[6].bias, -1e6)  # the last rectifiers never answer
        made.append(net)
        return net

    monkeypatch.setattr(module, "_build", dead_first)
    images, labels = bars
    machine = ContactImageCNN(epochs=10, schedule="constant", mirror=False, shift=0)
    machine.fit(images[:90], labels[:90])
    assert len(made) == 2
    assert machine.score(images[90:], labels[90:]) >= 0.9


def test_parts_of_a_batch_train_as_the_whole(bars, monkeypatch):
    pytest.importorskip("torch", reason="the extra `torch` is not installed")
    images, labels = bars
    shares = []
    for cached in (2**40, 1):  # the whole batch at once, and each image alone
        monkeypatch.setattr(module, "CACHED", cached)
        machine = ContactImageCNN(epochs=3, schedule="constant", mirror=False, shift=0)
        shares.append(machine.fit(images[:70], labels[:70]).predict_proba(images[70:]))
    # Float32 sums in another order, over nine steps.
    np.testing.assert_allclose(shares[0], shares[1], atol=1e-3)
    assert np.ptp(shares[0][:, 0]) > 0.1


def test_one_training_passes_the_shorter_ones_on_its_way(bars):
    pytest.importorskip("torch", reason="the extra `torch` is not installed")
    images = (bars[0].reshape(-1, 66, 100)[:40, ::2, ::2] / 255.0).astype(np.float32)
    number, names = np.arange(40) % 2, ("lying", "standing")
    steady = recipe(epochs=4, mirror=False, learning_rate=0.01)
    found = module.train_along(images, number, names, steady, epochs=(2, 4), seed=3)
    for epochs, net in zip((2, 4), found, strict=True):
        alone = module.train(images, number, names, recipe(**{
            "epochs": epochs, "mirror": False, "learning_rate": 0.01
        }), seed=3)  # fmt: skip
        np.testing.assert_array_equal(net.logits(images), alone.logits(images))
    hasty = recipe(epochs=4, learning_rate=1e9)
    assert module.train_along(images, number, names, hasty, epochs=(2, 4), seed=3)[-1] is None


def test_a_scaled_training_reads_images_as_they_come(bars):
    pytest.importorskip("torch", reason="the extra `torch` is not installed")
    images = (bars[0].reshape(-1, 66, 100)[:40, ::2, ::2] / 255.0).astype(np.float32)
    number, names, spread = np.arange(40) % 2, ("lying", "standing"), images.std()
    plain = recipe(epochs=4, learning_rate=1e-3)
    net = module.train(images, number, names, replace(plain, scaled=True), seed=3)
    by_hand = module.train(images / spread, number, names, plain, seed=3)
    np.testing.assert_allclose(net.logits(images), by_hand.logits(images / spread), rtol=1e-3)
    np.testing.assert_allclose(net.kernels[0] * spread, by_hand.kernels[0], rtol=1e-5)
    assert RECIPES["paper"].scaled
    # Images without any touch have no deviation.
    dark = module.train(np.zeros_like(images), number, names, recipe(epochs=1, scaled=True), seed=3)
    assert np.isfinite(dark.weight).all()


def test_varied_images_are_mirrored_and_shifted_copies():
    torch = pytest.importorskip("torch", reason="the extra `torch` is not installed")
    from skinmap.recognition.images.cnn import _varied

    image = torch.zeros(1, 1, 9, 12)
    image[0, 0, 4, 5], image[0, 0, 4, 6] = 1.0, 2.0
    many = _varied(torch, image.repeat(400, 1, 1, 1), recipe(shift=2)).numpy()[:, 0]
    np.testing.assert_array_equal(many.sum(axis=(1, 2)), 3.0)
    peaks = {tuple(np.argwhere(one == 2.0)[0]) for one in many}
    # Mirrored, the peak stands at column 5 or 6 of row 4; shifted, up to two around that.
    assert peaks == {(row, column) for row in range(2, 7) for column in range(3, 9)}
    same = _varied(torch, image, recipe(mirror=False))
    np.testing.assert_array_equal(same.numpy(), image.numpy())


def test_the_papers_network_has_its_size(bars):
    pytest.importorskip("torch", reason="the extra `torch` is not installed")
    images, labels = bars
    machine = ContactImageCNN("paper", epochs=1, batch=8).fit(images[:8], labels[:8])
    network = machine.trained
    assert [kernel.shape for kernel in network.kernels] == [
        (50, 1, 5, 5),
        (50, 50, 5, 5),
        (50, 50, 5, 5),
    ]
    assert network.weight.shape == (2, 50 * 8 * 12)


@pytest.mark.parametrize("unit", [None, *module.BFLOAT16])
def test_wide_networks_learn_in_mixed_precision_and_keep_float32_weights(bars, monkeypatch, unit):
    torch = pytest.importorskip("torch", reason="the extra `torch` is not installed")
    for name in module.BFLOAT16:
        answer = bool if name != unit else lambda: True
        monkeypatch.setattr(torch.cpu, name, answer, raising=False)
    seen = []
    build = module._build

    def watched(*arguments):
        net = build(*arguments)
        net[0].register_forward_hook(lambda _layer, _given, maps: seen.append(maps.dtype))
        return net

    monkeypatch.setattr(module, "_build", watched)
    images = (bars[0].reshape(-1, 66, 100)[:64, ::4, ::4] / 255.0).astype(np.float32)
    number = np.unique(bars[1][:64], return_inverse=True)[1]
    wide = module.Recipe(32, 1, 10, 16, 3e-2, "constant", False, 0)
    net = module.train(images, number, ("a", "b"), wide, seed=1)
    assert set(seen) == {torch.bfloat16 if unit else torch.float32}
    assert net.weight.dtype == np.float32
    assert (net.logits(images).argmax(axis=1) == number).mean() >= 0.9


def test_wide_networks_train_where_torch_knows_no_matrix_units(bars, monkeypatch):
    torch = pytest.importorskip("torch", reason="the extra `torch` is not installed")
    for name in module.BFLOAT16:
        monkeypatch.delattr(torch.cpu, name, raising=False)
    images, labels = bars
    machine = ContactImageCNN("paper", epochs=1, batch=8).fit(images[:8], labels[:8])
    assert machine.trained.weight.dtype == np.float32


def test_training_that_runs_away_is_an_error(bars):
    pytest.importorskip("torch", reason="the extra `torch` is not installed")
    images, labels = bars
    with pytest.raises(InvalidArrayError, match="lower it"):
        ContactImageCNN(epochs=3, learning_rate=1e6).fit(images[:64], labels[:64])


def test_what_cannot_be_trained_or_used_is_refused(bars):
    images, labels = bars
    with pytest.raises(UnknownNameError, match="no network 'huge'; the networks are: paper, small"):
        ContactImageCNN("huge").fit(images, labels)
    with pytest.raises(InvalidArrayError, match="two labels, got 1 class"):
        ContactImageCNN().fit(images[::2], labels[::2])
    for ask in (ContactImageCNN().predict, ContactImageCNN().predict_proba):
        with pytest.raises(NotFittedError, match="not trained yet"):
            ask(images)
