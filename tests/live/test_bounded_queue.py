from __future__ import annotations

import threading

import pytest

from skinmap.live.bounded_queue import BoundedQueue, QueueEnded

DEADLINE = 60.0


def test_items_come_in_order_and_their_sizes_are_kept():
    queue = BoundedQueue(10)
    assert all(queue.put(item, 3, patience=0.0) for item in "abc")
    assert queue.size == 9
    assert not queue.put("d", 3, patience=0.0)
    assert queue.take(0.0) == "a"
    # What was taken counts until the next is asked for.
    assert queue.size == 9
    assert [queue.take(0.0), queue.take(0.0)] == ["b", "c"]
    assert queue.take(0.0) is None
    assert queue.size == 0


def test_one_item_always_fits():
    queue = BoundedQueue(1)
    assert queue.put("large", 100, patience=0.0)
    assert queue.push("larger", 200) == ["large"]
    assert queue.take_all(0.0) == ["larger"]
    assert (queue.size, queue.take_all(0.0)) == (0, [])


def test_push_lets_the_oldest_go():
    queue = BoundedQueue(4)
    assert [queue.push(item, 2) for item in "abcd"] == [[], [], ["a"], ["b"]]
    assert queue.take_all(0.0) == ["c", "d"]


def test_the_end_comes_after_what_waits():
    queue = BoundedQueue(4)
    queue.put("a")
    queue.end(QueueEnded("over"))
    with pytest.raises(QueueEnded, match="over"):
        queue.put("b")
    assert queue.take(0.0) == "a"
    for _ in range(2):
        with pytest.raises(QueueEnded, match="over"):
            queue.take(DEADLINE)


def test_an_end_at_once_drops_what_waits():
    queue = BoundedQueue(4)
    queue.put("a")
    queue.end(KeyError("fault"), at_once=True)
    with pytest.raises(KeyError, match="fault"):
        queue.take_all(DEADLINE)
    assert queue.size == 0


@pytest.mark.parametrize("waits", ["put", "take", "take_all"])
def test_whoever_waits_is_told_of_the_end(waits):
    queue = BoundedQueue(1)
    queue.put("a")
    if waits != "put":
        queue.take_all(0.0)
    began, ended = threading.Event(), threading.Event()

    def wait():
        began.set()
        with pytest.raises(QueueEnded):
            queue.put("b") if waits == "put" else getattr(queue, waits)(None)
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    assert began.wait(DEADLINE)
    queue.end(QueueEnded(), at_once=True)
    assert ended.wait(DEADLINE)


def test_what_weighs_nothing_finds_room_in_a_full_queue():
    queue = BoundedQueue(1)
    assert queue.put("large", 100, patience=0.0)
    assert queue.put("mark", 0, patience=0.0)
    assert [queue.take(0.0), queue.take(0.0)] == ["large", "mark"]
