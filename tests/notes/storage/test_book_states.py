"""Two programs with one file of notes, which is lost now and then: both know all that either was told is kept."""

from __future__ import annotations

import tempfile
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from gcs_mosaic.notes.finds.finds import Find, Finds, NewFind, Outdated
from gcs_mosaic.notes.ground.binding import Binding
from gcs_mosaic.notes.storage.book import NotesBook

texts = st.text("ab ", max_size=3)
writers = st.sampled_from([0, 1])


class BookMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.known: dict[int, Find] = {}
        self.changes = 0

    @initialize()
    def begin(self) -> None:
        self.books = [NotesBook(Path(self.folder.name)) for _ in range(2)]

    @rule(writer=writers, label=texts)
    def set_a_find(self, writer: int, label: str) -> None:
        place = Binding(island=0, x=1.0, y=2.0)
        made = self.finds(writer).create(
            NewFind(kind="person", label=label, note="", who="Kim", in_original=False, binding=place)
        )
        assert made.id not in self.known
        self.note(made)

    @precondition(lambda self: self.known)
    @rule(writer=writers, label=texts, data=st.data())
    def edit(self, writer: int, label: str, data: st.DataObject) -> None:
        find = self.one(data)
        self.note(self.finds(writer).edit(find.id, find.revision, "Lou", {"label": label}, None))
        assert self.known[find.id].label == label

    @precondition(lambda self: self.known)
    @rule(writer=writers, data=st.data())
    def edit_what_has_changed_since(self, writer: int, data: st.DataObject) -> None:
        find = self.one(data)
        with pytest.raises(Outdated) as raised:
            self.finds(writer).edit(find.id, find.revision - 1, "Lou", {"label": "late"}, None)
        assert raised.value.newest == find

    @precondition(lambda self: self.known)
    @rule(writer=writers, data=st.data())
    def delete_or_bring_back(self, writer: int, data: st.DataObject) -> None:
        find, finds = self.one(data), self.finds(writer)
        change = finds.restore if find.deleted else finds.delete
        self.note(change(find.id, find.revision, "Lou"))
        assert self.known[find.id].deleted is not find.deleted

    @precondition(lambda self: self.changes)
    @rule(keeper=writers)
    def lose_the_file(self, keeper: int) -> None:
        """Both look every few seconds; until one looks again the notes are in the memory of both."""
        for book in self.books:
            book.keep()
        assert self.finds(keeper).all(deleted=True) == list(self.known.values())
        self.books[keeper].path.unlink()

    @rule(writer=writers)
    def start_again(self, writer: int) -> None:
        self.books[1 - writer].keep()
        self.books[writer].close()
        self.books[writer] = NotesBook(Path(self.folder.name))

    @invariant()
    def nobody_knows_less(self) -> None:
        if hasattr(self, "books"):
            for number, book in enumerate(self.books):
                assert self.finds(number).all(deleted=True) == list(self.known.values())
                assert book.revision == self.changes

    def teardown(self) -> None:
        for book in getattr(self, "books", []):
            book.close()
        with closing(NotesBook(Path(self.folder.name))) as book:
            assert Finds(book).all(deleted=True) == list(self.known.values())
        self.folder.cleanup()

    def finds(self, writer: int) -> Finds:
        return Finds(self.books[writer])

    def one(self, data: st.DataObject) -> Find:
        return self.known[data.draw(st.sampled_from(sorted(self.known)))]

    def note(self, find: Find) -> None:
        self.known[find.id] = find
        self.changes += 1


TestBook = BookMachine.TestCase
TestBook.settings = settings(max_examples=15, stateful_step_count=15)
