"""Pages of 320 px, touches behind the body, parts brought close, a page of another robot."""

from __future__ import annotations


def test_a_page_of_320_px_shows_all_of_its_width(open_desk, start):
    tab = open_desk(start().url)
    tab.wait()
    tab.page.set_viewport_size({"width": 320, "height": 600})
    cut = tab.page.evaluate(
        """() => {
          const all = document.querySelectorAll("#side select, #tools button, #player button");
          const cut = (one) => one.getBoundingClientRect().right > 320;
          return [...all].filter(cut).map(({ id }) => id);
        }"""
    )
    assert cut == []
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= 320
    tab.context.close()


def test_a_touch_behind_what_stands_before_it_is_told(open_desk, start):
    tab = open_desk(start().url)
    tab.wait()
    tab.page.evaluate("skinmap.link.ask({do: 'step', by: 1})")
    tab.until("document.querySelector('.label')")
    label = "document.querySelector('.label').textContent"
    assert not tab.page.evaluate(label).endswith("behind")
    # Its skin faces the camera, and no taxel is seen where it is.
    tab.page.evaluate(
        """() => {
          const { picture } = skinmap, taxelAt = picture.taxelAt.bind(picture);
          picture.taxelAt = () => -1;
          skinmap.looked.clear();
          skinmap.moved = -1e6;
          skinmap.showLabels();
          picture.taxelAt = taxelAt;
        }"""
    )
    assert tab.page.evaluate(label).endswith(", behind")
    tab.context.close()


def test_a_part_is_brought_close(open_desk, start):
    tab = open_desk(start().url)
    tab.wait()
    before = tab.page.evaluate("skinmap.camera.distance")
    tab.page.select_option("#part", "left_arm")
    assert tab.page.evaluate("skinmap.camera.distance") < before
    tab.page.select_option("#part", "")
    assert abs(tab.page.evaluate("skinmap.camera.distance") - before) < 1e-9
    tab.context.close()


def test_samples_of_another_robot_are_left_out_by_an_old_page(open_desk, start):
    tab = open_desk(start().url)
    tab.wait()
    drawn = tab.page.evaluate(
        """() => {
          skinmap.outdated = true;
          const before = skinmap.received;
          const header = { touches: [{ part: "wing" }] };
          skinmap.take({ header, arrays: { values: new Uint8Array(3) } });
          return skinmap.received - before;
        }"""
    )
    assert drawn == 0
    assert tab.faults == []
    tab.context.close()


def test_a_layer_that_takes_its_time_is_said_to_be_made(open_desk, start):
    tab = open_desk(start().url)
    tab.wait()
    tab.page.evaluate("skinmap.controls.words.working('structures')")
    tab.until("document.getElementById('bar-title').textContent.includes('is being made')")
    tab.page.evaluate("skinmap.controls.words.showLayer(skinmap.layer)")
    assert tab.page.evaluate("document.getElementById('bar-title').textContent") == "pressure"
    tab.context.close()
