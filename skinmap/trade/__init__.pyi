from skinmap.trade.front import knee, pareto, recommend
from skinmap.trade.measured import Point, TradeResult
from skinmap.trade.measuring import cpu_seconds, measure
from skinmap.trade.task import Knob, Outcome, TradeTask, tasks

__all__ = [
    "Knob",
    "Outcome",
    "Point",
    "TradeResult",
    "TradeTask",
    "cpu_seconds",
    "knee",
    "measure",
    "pareto",
    "recommend",
    "tasks",
]
