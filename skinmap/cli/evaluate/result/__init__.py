"""What `skinmap evaluate` measures: a file for each protocol, what they share beside them."""

from __future__ import annotations

from skinmap.cli.evaluate.result.baxter import BaxterResult
from skinmap.cli.evaluate.result.cross_patch import CrossPatchResult
from skinmap.cli.evaluate.result.in_time import TimeResult
from skinmap.cli.evaluate.result.kaspar import KasparResult
from skinmap.cli.evaluate.result.physics import PhysicsResult
from skinmap.cli.evaluate.result.real_skin import FingersResult, HandsResult
from skinmap.cli.evaluate.result.recordings import RecordingsResult
from skinmap.cli.evaluate.result.social_touch import CostResult

EvaluateResult = (
    KasparResult
    | CrossPatchResult
    | PhysicsResult
    | RecordingsResult
    | BaxterResult
    | TimeResult
    | CostResult
    | FingersResult
    | HandsResult
)
