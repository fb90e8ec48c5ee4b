"""See touches live"""

# %%
# Samples come in, touches with names come out, and a picture shows them. Here a simulator sends the
# samples of one hand; a robot would send them through LSL or ZeroMQ, and the rest stays as it is.
#
# Run it with `python docs/tutorials/see_touches_live.py`; it writes one picture into the folder
# that it is run in.
import skinmap

# %%
# ## A classifier
#
# Trained on simulated touches of the foot, so that the hand is new to it.
robot = skinmap.load_robot("icub")
touches = skinmap.simulate(robot.skin("left_foot"), per_gesture=15, rng=0)
classifier = skinmap.train(touches, robot)
print(classifier)

# %%
# ## From samples to touches
#
# `open_source` takes `sim`, a recording, `lsl:NAME` or `zmq:HOST:PORT`. The loop turns each sample
# into a `Moment`: pressures, and the touches with label and confidence. A simulation played at
# infinite speed does not wait for the clock.
source = skinmap.open_source("sim", robot=robot, parts=["left_hand"], seed=3, speed=float("inf"))
loop = skinmap.TouchLoop(robot, source, classifier=classifier)

# %%
# ## A picture
#
# `show` takes the moments of the loop and draws the one that tells most; without `path` it opens a
# window and goes on until that is closed.
skinmap.show(robot, loop, seconds=12.0, path="see_touches_live.png")
for touch in loop.finished():
    print(f"{touch.label:14s} confidence {touch.confidence:.0%}, {touch.duration:.2f} s")
loop.close()

# %%
# ![A named touch on the left hand, with its flat map](../pictures/tutorials/see_touches_live.png)
#
# With a robot: `skinmap view icub --source lsl:skin --model touch.skinmodel`. How to bring in a
# transport of your own is in [add a source](../howto/plugins.md#add-a-source), what a moment holds
# in [contacts](../contacts.md).
