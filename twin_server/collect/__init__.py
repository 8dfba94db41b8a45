"""First stage of the twin: whatever arrives in; features in order out, none missing unseen."""

from .account import DAMAGED, Account
from .backfill import Healer
from .reception import Reception
from .refusals import Refusals
from .runs import Aged, Arrival, Change, Holding, Lost, Ordered, Repeated, Rivals, Run, Want
from .sensors import SensorNotice, SensorWatch

__all__ = [
    "DAMAGED",
    "Account",
    "Aged",
    "Arrival",
    "Change",
    "Healer",
    "Holding",
    "Lost",
    "Ordered",
    "Reception",
    "Refusals",
    "Repeated",
    "Rivals",
    "Run",
    "SensorNotice",
    "SensorWatch",
    "Want",
]
