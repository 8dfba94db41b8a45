"""Frequencies, temperature and load in; what is not normal of their change, and alarms, out."""

from .basis import Basis as Basis
from .entry import Entry as Entry
from .entry import entry as entry
from .normal import Candidate as Candidate
from .normal import Normal as Normal
from .normal import learn_normal as learn_normal
from .onsets import Entered as Entered
from .watch import Judgement as Judgement
from .watch import Watch as Watch
from .watch import WatchState as WatchState
