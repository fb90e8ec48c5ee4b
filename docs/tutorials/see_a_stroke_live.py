"""See a stroke live"""

# %%
# A hand strokes the iCub's chest: which way does it go, how fast, and what is it called while it
# still goes on? A simulator sends the samples; a robot would send them through LSL or ZeroMQ, and
# the rest stays as it is.
#
# Run it with `python docs/tutorials/see_a_stroke_live.py`; it writes one picture into the folder
# that it is run in.
from pathlib import Path

import skinmap

# %%
# ## A classifier that looks at motion
#
# Trained on touches that go on in time, on another part of the robot. That they do is found out
# from the touches themselves; of touches that stay nothing would change.
robot = skinmap.load_robot("icub")
gestures = ["stroke", "tap", "rub", "hold"]
touches = skinmap.simulate(robot.skin("left_arm"), gestures=gestures, per_gesture=10, rng=0)
classifier = skinmap.train(touches, robot)
print(classifier)

# %%
# ## A stroke whose truth is known
#
# A simulated recording keeps what really happened, played here as a live source.
stroke = skinmap.simulate(robot.skin("torso"), gestures=["stroke"], per_gesture=1, rng=8)
truth = stroke.motions[0]
print(f"true: {1e3 * truth.speed:.0f} mm/s over {1e3 * truth.length:.0f} mm")
skinmap.save_recordings(stroke, "stroke.npz", robot=robot)
source = skinmap.open_source("stroke.npz", robot=robot, speed=float("inf"))
loop = skinmap.TouchLoop(robot, source, classifier=classifier)

# %%
# ## Moment by moment
#
# The motion of a touch is its velocity along the skin with a standard error, a heading in the
# axes of the part, and the way so far.
moments = []
for moment in loop:
    moments.append(moment)
    for touch in moment.touches:
        if len(moments) % 8 == 0:
            motion = touch.motion
            named = f"{moment.time:.2f} s  {touch.label:8s} {touch.confidence:.0%}"
            moves = f"{1e3 * motion.speed:.0f} mm/s (error {1e3 * motion.error:.0f})"
            print(f"{named}  {motion.heading:12s} {moves}, {1e3 * motion.length:.0f} mm so far")

# %%
# ## When it is over
#
# All of the touch names it once more; `early` is what it was called while it went on.
for touch in loop.finished():
    if touch.label != "touch":
        print(
            f"{touch.label}, {touch.heading}, {1e3 * touch.speed:.0f} mm/s; "
            f"called {touch.early} after {touch.early_after:.2f} s"
        )
loop.close()

# %%
# ## A picture
#
# The trace is the way of the centre, the arrow over the skin where it goes.
source = skinmap.open_source("stroke.npz", robot=robot, speed=float("inf"))
loop = skinmap.TouchLoop(robot, source, classifier=classifier)
skinmap.show(robot, loop, path="see_a_stroke_live.png")
loop.close()
Path("stroke.npz").unlink()

# %%
# ![A stroke on the chest with its trace and an arrow](../pictures/tutorials/see_a_stroke_live.png)
#
# With a robot: `skinmap view icub --source lsl:skin --model touch.skinmodel`. What is measured and
# how well is in [touches in time](../motion.md).
