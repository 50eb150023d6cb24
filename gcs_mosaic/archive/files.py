"""Files of a store: in a folder that all workers see, or in a bucket (S3, Google Cloud Storage, Azure)."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from uuid import uuid4

from gcs_mosaic.archive.artefacts import Files, ListedFile
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import CannotWrite, make_folder, telling_disk_full

# What of the environment is a bucket's: how the names begin, and those of the credentials that are usual.
AMAZON = "AWS", "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
GOOGLE = "GOOGLE", "GOOGLE_SERVICE_ACCOUNT"
AZURE = "AZURE", "AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY"
BUCKETS = {"s3": AMAZON, "gs": GOOGLE, "gcs": GOOGLE, **dict.fromkeys(("az", "azure", "abfs", "abfss"), AZURE)}
# How long a bucket is tried, in all and for a connection; obstore's own limit is three minutes.
PATIENCE = {"max_retries": 3, "retry_timeout": timedelta(seconds=20)}
CONNECTING = {"connect_timeout": timedelta(seconds=5), "timeout": timedelta(seconds=60)}
UNFINISHED = "unfinished"  # folder of files that are being written
BUCKETS_NEED = "buckets need the package obstore: pip install 'gcs-mosaic[cluster]', or name a folder"


def is_bucket(place: str) -> bool:
    """Whether this names a bucket, not a folder."""
    return urlsplit(place).scheme in BUCKETS and "://" in place


@lru_cache(8)
def files_at(place: str) -> Files:
    """The files at a folder or in a bucket. Raises UsageError."""
    return BucketFiles(place) if is_bucket(place) else FolderFiles(Path(place))


class FolderFiles:
    """Files below a folder, which is there. Files are begun in `UNFINISHED` of it: what a killed worker leaves can be found."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def write(self, name: str, data: bytes) -> None:
        path = self._root / name
        begun = self._root / UNFINISHED / uuid4().hex  # two workers, of one machine or two, may make the same at once
        try:
            make_folder(begun.parent, self._root)
            make_folder(path.parent, self._root)
            with telling_disk_full(path):
                with os.fdopen(
                    inside.descriptor(begun, self._root, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb"
                ) as file:
                    file.write(data)
                inside.move(begun, path, self._root)
        except OSError as error:
            if not self._root.is_dir():
                raise CannotWrite(f"{self._root} is not there: all workers need the same folder") from error
            raise CannotWrite(f"{path} cannot be written ({error.strerror}): choose another --out") from error
        finally:
            with suppress(OSError):
                inside.remove(begun, self._root)

    def read(self, name: str, start: int = 0, length: int | None = None) -> bytes | None:
        try:
            with inside.reading(self._root / name, self._root) as file:
                file.seek(start)
                return file.read(inside.LARGEST_FILE if length is None else length)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise CannotWrite(f"{self._root / name} cannot be read ({error.strerror})") from error

    def size(self, name: str) -> int | None:
        found = inside.status(self._root / name, self._root)
        return found.st_size if found is not None and stat.S_ISREG(found.st_mode) else None

    def listed(self, under: str) -> Iterator[ListedFile]:
        for path in inside.files(self._root / under if under else self._root, self._root):
            found = inside.status(path, self._root)
            if found is not None and path.parent != self._root / UNFINISHED:
                yield ListedFile(path.relative_to(self._root).as_posix(), found.st_size, found.st_mtime_ns)

    def remove(self, name: str) -> None:
        inside.remove(self._root / name, self._root)


class BucketFiles:
    """Files below a prefix of a bucket. Credentials and the like are taken from the environment, as its own tools do."""

    def __init__(self, place: str) -> None:
        try:
            import obstore
        except ImportError:
            raise UsageError(f"{place}: {BUCKETS_NEED}") from None
        self._place, self._obstore = place, obstore
        beginning, self._credentials = BUCKETS[urlsplit(place).scheme]
        options = _options(beginning)
        with self._told():
            self._store: Any = obstore.store.from_url(place, client_options=options, retry_config=PATIENCE)

    def write(self, name: str, data: bytes) -> None:
        try:
            with self._told():
                self._obstore.put(self._store, name, data)
        except FileNotFoundError:  # whatever else the server says of it
            raise CannotWrite(f"{self._place}: {NO_BUCKET}") from None

    def read(self, name: str, start: int = 0, length: int | None = None) -> bytes | None:
        part = {"offset": start} if length is None else (start, start + length)
        try:
            with self._told():
                found = self._obstore.get(self._store, name, options={"range": part} if part != {"offset": 0} else None)
                return bytes(found.bytes())
        except FileNotFoundError:
            return None
        except _BeyondError:
            return b""

    def size(self, name: str) -> int | None:
        try:
            with self._told():
                return int(self._obstore.head(self._store, name)["size"])
        except FileNotFoundError:
            return None

    def listed(self, under: str) -> Iterator[ListedFile]:
        with self._told():
            for some in self._obstore.list(self._store, prefix=under or None):
                yield from map(_listed, some)

    def remove(self, name: str) -> None:
        with suppress(FileNotFoundError), self._told():  # S3 does not tell, Google's and Azure's do
            self._obstore.delete(self._store, name)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Raise CannotWrite, in one sentence, for whatever a bucket may answer but that a file is not there."""
        try:
            yield
        except FileNotFoundError as error:
            if "NoSuchBucket" in str(error) or "container does not exist" in str(error):
                raise CannotWrite(f"{self._place}: {NO_BUCKET}") from None
            raise
        except (self._obstore.exceptions.BaseError, OSError, ValueError) as error:
            if any(sign in str(error) for sign in BEYOND):
                raise _BeyondError from None
            raise CannotWrite(f"{self._place}: {_reason(str(error), self._credentials)}") from error


class _BeyondError(Exception):
    """A part was asked for that begins beyond the file's end."""


BEYOND = ("416 Range Not Satisfiable", "InvalidRange", "Requested range was invalid")

NO_BUCKET = "there is no such bucket; make it, or name another one"
# What errors of buckets say, and what to do.
SIGNS = (
    (
        ("NoSuchBucket", "bucket does not exist", "BucketNotFound", "ContainerNotFound"),
        NO_BUCKET,
    ),
    (
        (
            *("169.254.169.254", "CredentialProvider", "Unauthenticated", "Missing AccessKeyId", "No credentials"),
            "Account must be specified",
        ),
        "credentials are missing; set those of the bucket's own tools, such as {credentials}",
    ),
    (
        (
            *(
                "AccessDenied",
                "PermissionDenied",
                "Forbidden",
                "InvalidAccessKeyId",
                "SignatureDoesNotMatch",
                "code: 403",
            ),
            "Invalid Access Key",
        ),
        "these credentials may not read or write there; ask for the right to, or name another bucket",
    ),
    (
        ("recognise URL", "known pattern"),
        "this names no bucket; give it as s3://BUCKET/PREFIX or az://CONTAINER/PREFIX",
    ),
    (("SlowDown", "503 Service Unavailable", "429 Too Many"), "it has too much to do; give the command again later"),
)


def _reason(told: str, credentials: str) -> str:
    """What an error of a bucket means, as the end of a sentence."""
    meant = next((meaning for signs, meaning in SIGNS if any(sign in told for sign in signs)), None)
    if meant is not None:
        return meant.format(credentials=credentials)
    return f"it cannot be reached ({' '.join(told.partition('Debug source')[0].split())[:200]})"


def _listed(meta: Any) -> ListedFile:
    modified_ns = int(meta["last_modified"].timestamp()) * 10**9
    return ListedFile(meta["path"], meta["size"], modified_ns, meta.get("e_tag") or "")


def _options(beginning: str) -> dict[str, Any]:
    insecure = os.environ.get(f"{beginning}_ALLOW_HTTP", "").lower() in ("1", "true")
    return CONNECTING | ({"allow_http": True} if insecure else {})
