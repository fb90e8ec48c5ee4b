import numpy as np
import pytest

from viewer.drawing.words.labels import Coverage, inside, leaders, overlaps, place_boxes

FRAME = (10.0, 10.0, 790.0, 590.0)


def areas(boxes):
    boxes = np.array(boxes)
    return np.array(
        [overlaps(boxes[i : i + 1], np.delete(boxes, i, axis=0))[0] for i in range(len(boxes))]
    )


@pytest.mark.parametrize("seed", range(5))
def test_place_boxes_keeps_many_labels_apart_and_inside(seed):
    rng = np.random.default_rng(seed)
    anchors = rng.uniform([0, 0], [800, 600], (9, 2))
    boxes = place_boxes(anchors, np.tile([120.0, 28.0], (9, 1)), FRAME)
    assert areas(boxes).max() == 0.0
    low, high = np.array(boxes)[:, :2], np.array(boxes)[:, 2:]
    assert (low >= 10).all()
    assert (high <= [790, 590]).all()


def post(size=(800, 600)):
    """A body that stands upright in the middle of the picture."""
    body = np.stack(np.meshgrid(np.arange(340, 460, 4), np.arange(0, 600, 4)), -1).reshape(-1, 2)
    return Coverage(body.astype(float), size)


@pytest.mark.parametrize(("x", "edge"), [(370.0, 340.0), (440.0, 460.0)])
def test_outline_lies_where_the_body_ends_nearest_to_a_hidden_place(x, edge):
    busy = post()
    column, row = busy.outline((x, 300.0))
    assert abs(column - edge) <= busy.cell
    assert abs(row - 300.0) <= busy.cell
    nothing = Coverage(np.zeros((0, 2)), (800, 600))
    assert nothing.outline((x, 300.0)) == pytest.approx((x, 300.0), abs=nothing.cell)


def test_the_line_of_a_hidden_touch_does_not_cross_the_body():
    busy, size = post(), np.array([[100.0, 30.0]])
    anchor = np.array([busy.outline((440.0, 300.0))])
    before = [(150.0, 285.0, 250.0, 315.0)]  # it would like to stay on the other side
    lines = [
        leaders(anchor[0], np.array(place_boxes(anchor, size, FRAME, (), before, busy, hidden)))
        for hidden in ([True], [False])
    ]
    shares = [float(busy.on(line).mean()) for line in lines]
    assert shares[0] <= 2 / 24  # it begins on the outline
    assert shares[1] > 2 / 24  # what is seen is pointed at over the body


@pytest.mark.parametrize("seed", range(5))
def test_lines_do_not_run_under_the_boxes_that_were_there(seed):
    rng = np.random.default_rng(seed)
    anchors = rng.uniform([300, 200], [500, 400], (5, 2))
    boxes = np.array(place_boxes(anchors, np.tile([120.0, 30.0], (5, 1)), FRAME))
    for k in range(1, 5):
        covered = inside(anchors[k : k + 1, None], boxes[:k])[0]  # nothing helps there
        assert covered or inside(leaders(anchors[k], boxes[k : k + 1]), boxes[:k])[0] == 0.0


def test_place_boxes_keeps_clear_of_what_is_to_be_avoided_and_of_the_body():
    anchor, size = np.array([[400.0, 300.0]]), np.array([[100.0, 30.0]])
    body = np.stack(np.meshgrid(np.arange(340, 460, 4), np.arange(0, 600, 4)), -1).reshape(-1, 2)
    bar = (460.0, 200.0, 790.0, 400.0)
    busy = Coverage(body.astype(float), (800, 600))
    box = np.array(place_boxes(anchor, size, FRAME, [bar], busy=busy))
    assert overlaps(box, np.array([bar]))[0] == 0.0
    assert busy.under(box)[0] == 0.0


def test_place_boxes_stays_where_it_was_when_little_moves():
    size = np.array([[100.0, 30.0]])
    first = place_boxes(np.array([[400.0, 300.0]]), size, FRAME)
    assert first[0][1] > 300.0, "above, which costs as much as below"
    below = (first[0][0], 600.0 - first[0][3], first[0][2], 600.0 - first[0][1])
    moved = np.array([[403.0, 301.0]])
    assert place_boxes(moved, size, FRAME)[0][1] > 300.0
    assert place_boxes(moved, size, FRAME, before=[below])[0][3] < 300.0


def test_place_boxes_with_a_box_larger_than_the_frame_still_answers():
    boxes = place_boxes(np.array([[5.0, 5.0]]), np.array([[900.0, 700.0]]), FRAME)
    assert len(boxes) == 1


def test_coverage_counts_cells_under_a_box():
    busy = Coverage(np.array([[6.0, 6.0], [18.0, 6.0], [500.0, -3.0]]), (100, 50), cell=12)
    boxes = np.array([[0.0, 0.0, 24.0, 12.0], [24.0, 0.0, 48.0, 12.0], [-50.0, -9.0, 12.0, 90.0]])
    assert busy.under(boxes).tolist() == [288.0, 0.0, 144.0]
