"""What is kept changes as a whole, or it is as it was."""

import threading
from array import array
from collections import Counter, OrderedDict, deque
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from whole_state import digest

from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.retrieval import LEARN_AT, PER_FRAME, RetrievalIndex
from gcs_mosaic.stitch.transaction import EachWhole, Kept, Snapshot, attempt, transaction


class Leaf(Kept):
    strange: object  # only where a test gives it one

    def __init__(self) -> None:
        self.count = 0
        self.names = ["a"]


class Branch(Kept):
    FIXED = frozenset({"lock"})
    new: list[int]  # only once it has been changed

    def __init__(self) -> None:
        self.leaf = Leaf()
        self.by_key = {"one": 1}
        self.seen = {1, 2}
        self.ordered = OrderedDict(a=1)
        self.counts = Counter("aab")
        self.queue = deque([1, 2], maxlen=3)
        self.rows = array("q", [1, 2])
        self.places = np.zeros((2, 2))
        self.label: str | None = None
        self.lock = threading.Lock()


def changed_and_failed(error: BaseException | type[BaseException], *branches: Branch) -> None:
    """A transaction in which everything is changed before something is raised."""
    with transaction(*branches):
        for branch in branches:
            change(branch)
        raise error


def told(branch: Branch) -> tuple[dict[str, object], dict[str, str]]:
    """Every value that is kept, in a form that later changes do not reach."""
    inner = {name: list(value) if isinstance(value, list) else value for name, value in vars(branch.leaf).items()}
    own = {name: repr(value) for name, value in vars(branch).items() if name not in ("leaf", "lock")}
    return inner, own


def change(branch: Branch) -> None:
    """Everything: in place where that is possible, and by another value elsewhere."""
    branch.leaf.count += 1
    branch.leaf.names.append("b")
    branch.by_key["two"] = 2
    branch.seen.discard(1)
    branch.ordered.move_to_end("a")
    branch.ordered["b"] = 2
    branch.counts["c"] += 1
    branch.queue.append(3)
    branch.queue.append(4)
    branch.rows.append(3)
    branch.places[0] = 7
    branch.label = "changed"
    branch.new = [1]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, GeneratorExit, MemoryError])
def test_whatever_is_raised_everything_is_as_it_was(error: type[BaseException]) -> None:
    branch = Branch()
    before = told(branch)
    with pytest.raises(error):
        changed_and_failed(error, branch)
    assert told(branch) == before


def test_what_ends_well_is_kept() -> None:
    branch = Branch()
    with transaction(branch):
        change(branch)
    assert (branch.leaf.count, branch.leaf.names, branch.label, branch.new) == (1, ["a", "b"], "changed", [1])
    assert branch.places[0].tolist() == [7, 7]


def test_an_attempt_that_nobody_keeps_is_undone() -> None:
    branch = Branch()
    before = told(branch)
    with attempt(branch) as trial:
        change(branch)
    assert not trial.kept
    assert told(branch) == before


def test_an_attempt_that_was_kept_is_undone_all_the_same_if_it_raises_afterwards() -> None:
    branch = Branch()
    before = told(branch)

    def interrupted() -> None:
        with attempt(branch) as trial:
            change(branch)
            trial.keep()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert told(branch) == before


def test_a_part_that_was_replaced_is_back_itself() -> None:
    branch = Branch()
    leaf = branch.leaf
    with attempt(branch):
        branch.leaf = Leaf()
        leaf.count = 5
    assert branch.leaf is leaf
    assert leaf.count == 0


def test_attempts_within_a_transaction_are_undone_one_by_one() -> None:
    branch = Branch()
    with transaction(branch):
        branch.leaf.names.append("first")
        with attempt(branch):
            branch.leaf.names.append("second")
        with attempt(branch.leaf) as trial:
            branch.leaf.names.append("third")
            trial.keep()
    assert branch.leaf.names == ["a", "first", "third"]


def test_what_an_inner_attempt_has_kept_is_undone_with_the_outer_one() -> None:
    branch = Branch()
    before = told(branch)
    with attempt(branch):
        with attempt(branch.leaf) as trial:
            change(branch)
            trial.keep()
        assert branch.leaf.count == 1
    assert told(branch) == before


def test_several_parts_are_put_back_together() -> None:
    one, other = Branch(), Branch()
    before = told(one), told(other)
    with pytest.raises(KeyError):
        changed_and_failed(KeyError, one, other)
    assert (told(one), told(other)) == before


class Stubborn(Leaf):
    """Cannot be put back."""

    def restore(self, before: Snapshot) -> None:
        raise MemoryError("stubborn")


def test_what_cannot_be_put_back_keeps_nothing_else_from_it() -> None:
    first, last = Branch(), Branch()
    before = told(last)
    first.leaf = Stubborn()  # the first of its attributes
    with pytest.raises(MemoryError, match="stubborn") as raised:
        changed_and_failed(KeyError(), first, last)
    assert isinstance(raised.value.__context__, KeyError)
    assert (first.label, first.by_key, told(last)) == (None, {"one": 1}, before)


def each_tried(branch: Branch, returned: list[object], *steps: Callable[[Branch], object]) -> None:
    with EachWhole(branch, otherwise="it failed") as each:
        for step in steps:
            returned.append(each.tried(partial(step, branch)))


def failing(error: Exception, branch: Branch) -> None:
    change(branch)
    raise error


def test_of_several_steps_each_is_done_or_undone_and_the_first_error_is_raised() -> None:
    branch = Branch()
    returned: list[object] = []
    with pytest.raises(KeyError):
        each_tried(branch, returned, partial(failing, KeyError()), partial(failing, ValueError()), change, told)
    assert returned == [None, None, None, told(branch)]
    assert (branch.leaf.names, branch.label) == (["a", "b"], "changed")


def test_a_step_that_cannot_even_begin_keeps_no_other_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot = Branch.snapshot
    refused: list[Branch] = []

    def refusing_once(branch: Branch) -> Snapshot:
        if not refused:
            refused.append(branch)
            raise MemoryError
        return snapshot(branch)

    monkeypatch.setattr(Branch, "snapshot", refusing_once)
    branch = Branch()
    returned: list[object] = []
    with pytest.raises(MemoryError):
        each_tried(branch, returned, told, told)
    assert returned == [None, told(branch)]


class Mutable:
    pass


@pytest.mark.parametrize("value", [Mutable(), threading.Event(), iter([1]), bytearray(b"1")])
def test_what_could_not_be_put_back_is_refused_before_anything_is_done(value: object) -> None:
    branch, done = Branch(), []
    branch.leaf.strange = value
    with pytest.raises(TypeError, match=f"strange is a {type(value).__name__}"), transaction(branch):
        done.append(True)
    assert not done


def test_what_belongs_to_no_frame_is_left_alone() -> None:
    branch = Branch()
    with attempt(branch):
        branch.lock = other = threading.Lock()
    assert branch.lock is other


# The index of descriptors, of which only the length is remembered


def some_features(seed: int) -> Features:
    noise = np.random.default_rng(seed)
    return Features(
        noise.uniform(0, 100, (PER_FRAME, 2)).astype(np.float32),
        noise.integers(0, 255, (PER_FRAME, 128)).astype(np.uint8),
        100, 100, 1.0,
    )  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("known", [0, 1, LEARN_AT[0] - 1, LEARN_AT[0]])
def test_an_index_forgets_what_was_added_even_where_its_vocabulary_was_learnt_meanwhile(known: int) -> None:
    """At 63 frames the next one lets it learn its words; at 64 it makes room for more."""
    index, undisturbed = RetrievalIndex(), RetrievalIndex()
    for seed in range(known):
        index.add(some_features(seed))
        undisturbed.add(some_features(seed))
    before = digest(index)
    with attempt(index):
        for seed in (1000, 1001):
            index.add(some_features(seed))
    assert digest(index) == before == digest(undisturbed)
    for seed in (known, known + 1):
        index.add(some_features(seed))
        undisturbed.add(some_features(seed))
    assert digest(index) == digest(undisturbed)
    among = np.arange(known + 2)
    asked = some_features(known)
    assert index.likeliest(asked, among, 3) == undisturbed.likeliest(asked, among, 3)
    assert index.likeliest(asked, among, 1) == [known]


def test_an_index_goes_back_while_something_looks_into_it() -> None:
    """As the traceback of whatever made it go back may do."""
    index, undisturbed = RetrievalIndex(), RetrievalIndex()
    for one in (index, undisturbed):
        one.add(some_features(0))
    with attempt(index):
        index.add(some_features(1))
        looking = np.frombuffer(index._rows[0], np.int64)
    assert len(looking) == 2 * PER_FRAME
    assert digest(index) == digest(undisturbed)


def test_an_index_grows_after_a_query_that_raised_and_is_remembered() -> None:
    index = RetrievalIndex()
    index.add(some_features(0))
    index.add(some_features(1))
    index._count = 1  # so that the words name a frame that there is not
    with pytest.raises(IndexError) as remembered:
        index.likeliest(some_features(0), np.arange(1), 1)
    index._count = 2
    index.add(some_features(2))
    assert index.likeliest(some_features(2), np.arange(3), 1) == [2]
    assert remembered.value.__traceback__ is not None


def test_an_index_goes_back_step_by_step() -> None:
    index = RetrievalIndex()
    index.add(some_features(0))
    with attempt(index):
        index.add(some_features(1))
        inner = digest(index)
        with attempt(index):
            index.add(some_features(2))
        assert digest(index) == inner
    alone = RetrievalIndex()
    alone.add(some_features(0))
    assert digest(index) == digest(alone)
