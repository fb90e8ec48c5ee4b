#!/usr/bin/env bash
# From nothing to a picture of one's own robot, in a folder that is empty or new.
#
#   docs/examples/own_robot.sh FOLDER
set -euo pipefail
robot="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/robot"

skinmap new "$robot/robot.urdf" --taxels "$robot/forearm.csv" -o "$1/robot.toml"
skinmap inspect "$1/robot.toml"
skinmap flatten "$1/robot.toml" --out "$1/maps"
skinmap view "$1/robot.toml" --source sim --screenshot "$1/touches.png"
