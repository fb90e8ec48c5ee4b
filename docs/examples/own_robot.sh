#!/usr/bin/env bash
# From nothing to a picture of one's own robot, in a folder that is empty or new.
#
#   docs/examples/own_robot.sh FOLDER
set -euo pipefail
folder=${1:?the folder to write to is missing: docs/examples/own_robot.sh FOLDER}
robot="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/robot"

skinmap new "$robot/robot.urdf" --taxels "$robot/forearm.csv" -o "$folder/robot.toml"
skinmap inspect "$folder/robot.toml"
skinmap flatten "$folder/robot.toml" --out "$folder/maps"
skinmap view "$folder/robot.toml" --source sim --screenshot "$folder/touches.png"
