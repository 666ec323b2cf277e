"""A store's place in an object store: s3://BUCKET/PREFIX, or gs:// or az:// alike.

An object appears whole or not at all, so chunks are simply put. Nothing can be renamed: a group is
there if its own zarr.json is, which is written last and deleted first. One driver at a time, by a
lease.

Credentials, endpoint and region come from the environment (AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, …),
of the driver and of every worker, and go nowhere from there.
"""

import re
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from typing import ClassVar

import obstore
from obstore.exceptions import BaseError
from obstore.store import AzureStore, GCSStore, S3Store

from pipeline import lease
from pipeline.faults import StorageError, StoreError

_KINDS = {"s3": S3Store, "gs": GCSStore, "az": AzureStore}
_URL = re.compile(r"(s3|gs|az)://([a-z0-9][a-z0-9._-]+)((?:/[\w.=+-]+)+)/?", re.ASCII)
PATIENCE = 30
"""Seconds for which a request is repeated while the store does not answer."""


def parse(url):
    """(kind, bucket, prefix) of a URL; StoreError with an example otherwise."""
    match = _URL.fullmatch(url)
    if not match or {".", ".."} & set(url.split("/")):
        # The URL is not repeated: what is wrong with it may be a password in it.
        raise StoreError(
            "the URL of the store must be s3://BUCKET/PREFIX (or gs://, az://), of letters, digits "
            "and ._=+-, without user, password or '?'; credentials go into the environment, "
            "e.g. AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
        )
    kind, bucket, prefix = match.groups()
    return kind, bucket, prefix.strip("/")


@dataclass(frozen=True)
class Objects:
    """url : str, see `parse`."""

    url: str
    groups_appear_whole: ClassVar[bool] = False
    probe: ClassVar[str] = ".probe"

    def __str__(self):
        return self.url

    @property
    def _store(self):
        with self.explained():
            return _opened(self.url)

    def names(self, key=""):
        """First parts of the keys below that others have put there, or we before."""
        with self.explained():
            found = self._store.list_with_delimiter(key or None)
        paths = [*found["common_prefixes"], *(entry["path"] for entry in found["objects"])]
        return {path.rpartition("/")[2] for path in paths} - lease.KEYS - {self.probe}

    @contextmanager
    def held(self):
        """Hold the prefix as its one driver."""
        with self.explained(), lease.leased(self._store, self.url):
            yield

    def driver(self):
        """Who holds the prefix now, in words; "" if nobody does."""
        with self.explained():
            return lease.holder(self._store)

    def put(self, key, data):
        """Write the object."""
        with self.explained():
            self._store.put(key, data)

    def put_files(self, key, files):
        """Write the files {name below the key: bytes}, the root of a group last."""
        with self.explained():
            for name in sorted(files, key="zarr.json".__eq__):
                self._store.put(f"{key}/{name}", files[name])

    def put_group(self, key, files):
        """Write the files {key in the group: bytes} in place of what is there.

        A reader, or a run after a crash, meanwhile finds no group of this name.
        """
        with self.explained():
            self.delete_group(key)
        self.put_files(key, files)

    def delete_group(self, key):
        """Delete a group and all below, if it is there: its root, by which it is there, first."""
        root, old = f"{key}/zarr.json", dict(self.sizes(key))
        self.delete([root] if root in old else [])
        self.delete(list(old.keys() - {root}))

    def read(self, key):
        """The bytes of an object, or None if it is not there."""
        with self.explained():
            try:
                return bytes(self._store.get(key).bytes())
            except FileNotFoundError as error:
                return _absent(error)

    def size(self, key):
        """The length of an object in bytes, or None if it is not there."""
        with self.explained():
            try:
                return self._store.head(key)["size"]
            except FileNotFoundError as error:
                return _absent(error)

    def sizes(self, prefix):
        """Yield (key, bytes) of all objects below; no list of them is kept."""
        for entry in self._entries(prefix):
            yield entry["path"], entry["size"]

    def changes(self, prefix):
        """{key: (bytes, time of its last change in seconds)} of all objects below."""
        return {
            entry["path"]: (entry["size"], entry["last_modified"].timestamp())
            for entry in self._entries(prefix)
        }

    def _entries(self, prefix):
        with self.explained():
            for page in self._store.list(prefix):
                yield from page

    def delete(self, keys):
        """Delete the objects; one that is not there is none to delete."""
        if keys:
            with self.explained():
                obstore.delete(self._store, keys)

    def zarr_store(self, key):
        """What zarr reads there."""
        from zarr.storage import ObjectStore

        return ObjectStore(_opened(f"{self.url.rstrip('/')}/{key}"), read_only=True)

    @contextmanager
    def explained(self):
        """All errors of the object store, ours and others' as they read there, in words."""
        try:
            yield
        except (BaseError, FileNotFoundError) as error:
            if getattr(error, "errno", None) is not None:  # a file of this machine, not an object
                raise
            raise StorageError(f"{self} {_cause(str(error))}") from None
        except BaseException as error:
            # A setting that obstore cannot digest, e.g. an endpoint that is no URL, ends it so.
            if type(error).__name__ != "PanicException":
                raise
            raise StorageError(f"{self} {_cause('')}") from None


@lru_cache
def _opened(url):
    kind, bucket, prefix = parse(url)
    retry = {"max_retries": 100, "retry_timeout": timedelta(seconds=PATIENCE)}
    return _KINDS[kind](bucket, prefix=prefix, retry_config=retry)


def _absent(error):
    """None for an object that is not there; the error itself if its bucket is not."""
    if _NO_BUCKET.search(str(error)):
        raise error
    return None


_NO_BUCKET = re.compile("NoSuchBucket|ContainerNotFound")
_REFUSED = re.compile(
    r"status code: 40[13]|necessary privileges|valid authentication|169\.254\.169"
)


def _cause(text):
    """What is wrong, by the store's answer; never the answer itself, which may hold a signature."""
    if _NO_BUCKET.search(text):
        return "is in a bucket that does not exist; create it, or correct the URL"
    if _REFUSED.search(text):
        return (
            "cannot be used with the credentials of the environment; set AWS_ACCESS_KEY_ID and "
            "AWS_SECRET_ACCESS_KEY, or those of your kind of store"
        )
    answer = re.search(r"<Code>(\w+)</Code>", text) or re.search(r"status code: (\d+)", text)
    if answer:
        return f"answers {answer[1]}; put that right"
    if "HTTP error" in text:
        return (
            f"does not answer within {PATIENCE} s; look to the network and the endpoint "
            "(AWS_ENDPOINT_URL, and AWS_ALLOW_HTTP=true for http)"
        )
    return (
        "cannot be opened with what the environment says; see what your kind of store needs there"
    )
