from skinmap.trade.front import pareto, recommend
from skinmap.trade.measuring import Point, TradeResult, cpu_seconds, measure
from skinmap.trade.task import Knob, Outcome, TradeTask

__all__ = [
    "Knob",
    "Outcome",
    "Point",
    "TradeResult",
    "TradeTask",
    "cpu_seconds",
    "measure",
    "pareto",
    "recommend",
]
