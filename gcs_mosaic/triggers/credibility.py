"""Which sources of events agree with the files that arrive: a forged counter, or a camera filmed elsewhere, does not. Pure.

Each source's shots are compared with all files by themselves: a source is as good as the files that it explains at one delay,
less its shots that brought none. Doubt only decides who comes first: a doubtful source gets the files that no other claims.
"""

from __future__ import annotations

from collections import OrderedDict, deque

from gcs_mosaic.messages import Teller
from gcs_mosaic.triggers.delay import MOST_FILES, MOST_SHOTS, UsualDelay
from gcs_mosaic.triggers.settings import PairingSettings

_MOST_SOURCES = 32  # whose shots are kept; those that agree least are forgotten
_JUDGED = 9  # sources compared with each file: the best so far, the newest, and those that announce as many as come
_KNOWN = 3.0  # files that a source must explain before another one is doubted
_SILENT_S, _SILENT_SHOTS = 2.0, 4  # a source silent for longer than both, in its own usual gaps, has ended or paused
_SHARE = 0.25  # of the best source's agreement, below which a source is doubted


class Credibility:
    """The shots of every source, and how well they agree with the files."""

    def __init__(self, settings: PairingSettings) -> None:
        self._settings = settings
        self._sources: OrderedDict[Teller, UsualDelay] = OrderedDict()  # last heard last
        self._agreement: dict[Teller, float] = {}
        self._last: dict[Teller, float] = {}  # newest shot
        self._best: Teller | None = None
        self._files = 0
        self._recent: deque[float] = deque(maxlen=MOST_FILES)  # files
        self._judged: dict[Teller, int] = {}  # up to which file
        self._none_yet = self._new()

    @property
    def delay(self) -> UsualDelay:
        """That of the source that agrees best."""
        return self._none_yet if self._best is None else self._sources[self._best]

    def shot(self, teller: Teller, moment: float) -> None:
        """A source says that a picture was taken."""
        if teller not in self._sources and len(self._sources) >= _MOST_SOURCES:
            # Of those that agree least the one that announces most: forgers are many, and talk more than a camera takes.
            others = (one for one in self._sources if one != self._best)
            self._forget(min(others, key=lambda one: (self._agreement_of(one), -self._sources[one].shots)))
        if teller not in self._judged:  # its first messages may have been held back, until after their files
            since = sum(received >= moment for received in self._recent)
            self._judged[teller] = self._files - since
        self._sources.setdefault(teller, self._new()).shot(moment)
        self._sources.move_to_end(teller)
        self._last[teller] = max(moment, self._last.get(teller, moment))
        if self._best is None:
            self._best = teller

    def file(self, received: float) -> None:
        """A file has arrived: judge the sources by it."""
        by_merit = sorted(filter(self._goes_on, self._sources), key=self._agreement_of, reverse=True)
        self._recent.append(received)
        self._files += 1
        newest = [teller for teller in reversed(self._sources) if teller in by_merit]
        fitting = sorted(by_merit, key=lambda one: abs(self._sources[one].shots - min(self._files, MOST_SHOTS)))
        for teller in dict.fromkeys(one for row in (by_merit, newest, fitting) for one in row[: _JUDGED // 3]):
            self._catch_up(teller)
            self._agreement[teller] = self._sources[teller].agreement()
        if not by_merit:
            return
        # Of equals the one that announces fewest shots.
        self._best = max(by_merit, key=lambda one: (self._agreement_of(one), -self._sources[one].shots))

    def _catch_up(self, teller: Teller) -> None:
        """Compare a source with the files since it was last judged: the first ones tell how long files take, not the newest."""
        missed = min(self._files - self._judged.get(teller, 0), len(self._recent))
        for received in list(self._recent)[len(self._recent) - missed :]:
            self._sources[teller].file(received)
        self._judged[teller] = self._files

    def is_doubtful(self, teller: Teller) -> bool:
        """Whether its shots agree with the files far less than those of another source."""
        best = self._agreement_of(self._best) if self._best is not None else 0.0
        return best >= _KNOWN and self._agreement_of(teller) < _SHARE * best

    def rank(self, teller: Teller) -> int:
        """0: doubtful, 2: its shots have proved true, 1: nothing is known."""
        if self.is_doubtful(teller):
            return 0
        return 2 if self._agreement_of(teller) >= _KNOWN else 1

    def credible(self) -> frozenset[Teller]:
        """The sources whose shots have proved true."""
        return frozenset(one for one in self._agreement if self.rank(one) == 2)

    def _goes_on(self, teller: Teller) -> bool:
        """Whether it still announces shots, while others do; files that came after its last say nothing about it."""
        silent_s = max(self._last.values()) - self._last[teller]
        return silent_s <= max(_SILENT_S, _SILENT_SHOTS * self._sources[teller].usual_gap_s)

    def _agreement_of(self, teller: Teller) -> float:
        return self._agreement.get(teller, 0.0)

    def _new(self) -> UsualDelay:
        return UsualDelay(self._settings.early_s, self._settings.window_s, self._settings.spread_s)

    def _forget(self, teller: Teller) -> None:
        del self._sources[teller]
        del self._last[teller]
        self._agreement.pop(teller, None)
        self._judged.pop(teller, None)
