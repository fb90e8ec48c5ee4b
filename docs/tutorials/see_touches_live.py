"""See touches live"""

# %%
# Samples come in, touches with names come out, and a scene shows them. Here a simulator sends the
# samples of one hand; a robot would send them through LSL or ZeroMQ, and the rest stays as it is.
#
# Run it with `python docs/tutorials/see_touches_live.py FOLDER`; it writes one picture there.
import sys
from pathlib import Path

import numpy as np

import skinmap
from skinmap.classify.classifier import classifiers
from skinmap.classify.evaluate import split_touches
from skinmap.live import TouchLoop, open_source
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import simulate
from viewer.scene import Scene

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)

# %%
# ## A classifier
#
# Trained on simulated touches of the foot, so that the hand is new to it.
rng = np.random.default_rng(0)
robot = skinmap.load_robot("icub")
foot = PreparedSkin(robot.skin("left_foot"))
recording = simulate(foot.skin, rng=rng, per_gesture=15)
split = split_touches({"left_foot": foot}, [recording], ["left_foot"], rng=rng)
model = classifiers.get("contact-geometry")().fit(split.train, rng=rng)
print("trained on", len(split.train), "touches:", ", ".join(model.labels))

# %%
# ## From samples to touches
#
# `open_source` takes `sim`, a recording, `lsl:NAME` or `zmq:PORT`. The loop turns each sample into
# a `Moment`: pressures, and the touches with label and confidence. A simulation played at infinite
# speed does not wait for the clock.
source = open_source("sim", robot=robot, parts=["left_hand"], seed=3, speed=float("inf"))
loop = TouchLoop(robot, source, classifier=model)
shown = None
named = []
while len(named) < 6:
    moment = loop.step(5.0)
    if moment is None:
        break
    for touch in moment.touches:
        sure = touch.confidence if np.isfinite(touch.confidence) else 0.0
        if shown is None or sure * len(touch.taxels) > shown[0]:
            shown = (sure * len(touch.taxels), moment)
    named += loop.finished()
loop.close()
for event in named:
    print(f"{event.label:14s} {event.confidence:.0%} sure, {event.duration:.2f} s")

# %%
# ## A picture of one moment
#
# A `Scene` needs no window; `viewer.window.play(scene, moments)` opens one.
scene = Scene.load(robot, ["left_hand"], links="skin", window_size=(960, 640))
scene.show_moment(shown[1])
scene.show_flat_map("left_hand")
scene.screenshot(folder / "see_touches_live.png")
scene.close()

# %%
# ![A named touch on the left hand, with its flat map](../pictures/tutorials/see_touches_live.png)
#
# With a robot: `skinmap view icub --source lsl:skin --model touch.skinmodel`. How to bring in a
# transport of your own is in [add a source](../howto/source.md), what a moment holds in
# [contacts](../contacts.md).
