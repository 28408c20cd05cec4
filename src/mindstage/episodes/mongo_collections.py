"""Collections of MongoDB as files: the BSON that `mongodump` writes, the JSON of `mongoexport`, both also with gzip.

Formats: bsonspec.org 1.1; a dump is the documents of a collection, one after the other, as in the database.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import msgspec

from mindstage.errors import EpisodeFileError

if TYPE_CHECKING:
    from bson.codec_options import CodecOptions

__all__ = ["find_collection", "read_collection"]

_MAX_DOCUMENT_BYTES = 16 * 2**20 + 16 * 2**10
"""MongoDB's limit of a document, with what the server may add."""
_MAX_LINE_BYTES = 2 * _MAX_DOCUMENT_BYTES
"""A JSON document can be longer than the same as BSON."""
_DEPTHS = ("*", "*/*", "*/*/*")
"""A dump has `COLLECTION/DATABASE/COLLECTION.bson`."""
_ENDINGS = (".json", ".bson", ".json.gz", ".bson.gz")


_Bytes = BinaryIO | gzip.GzipFile


def find_collection(folder: Path, name: str) -> Path | None:
    """The file of a collection in a folder or up to two folders below, the nearest one; None if there is none.

    The collection may have a prefix, as in `5f22_tf.bson`.

    Raises:
        EpisodeFileError: several are equally near.
    """
    for depth in _DEPTHS:
        for ending in _ENDINGS:
            found = sorted(
                path
                for path in folder.glob(depth + ending)
                if f"_{path.name.removesuffix(ending)}".endswith(f"_{name}") and path.is_file()
            )
            if len(found) > 1:
                names = ", ".join(str(path.relative_to(folder)) for path in found)
                cause = f"it has several collections {name}: {names}"
                raise EpisodeFileError(str(folder), cause=cause, remedy="give a folder with those of one episode")
            if found:
                return found[0]
    return None


def read_collection(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """The documents of a file `.json`, one a line, or `.bson`, each with its place, such as "line 7".

    Dates and decimal numbers of BSON are `{"$date": milliseconds}` and `{"$numberDecimal": text}`, as in JSON.

    Raises:
        EpisodeFileError: the file cannot be read, or is damaged; or `bson` is not installed.
    """
    is_zipped = path.suffix == ".gz"
    documents = _json_documents if path.with_suffix("" if is_zipped else path.suffix).suffix == ".json" else _bson
    try:
        with gzip.open(path) if is_zipped else path.open("rb") as file:
            yield from documents(path, file)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise EpisodeFileError(str(path), cause=f"its gzip data is damaged: {error}") from error
    except OSError as error:
        raise EpisodeFileError(str(path), cause=error.strerror or str(error)) from error


def _json_documents(path: Path, file: _Bytes) -> Iterator[tuple[str, dict[str, Any]]]:
    number = 0
    while line := file.readline(_MAX_LINE_BYTES):
        number += 1
        if line.strip():
            try:
                document = msgspec.json.decode(line, type=dict[str, Any])
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                raise EpisodeFileError(
                    str(path),
                    cause=f"line {number} is no JSON document: {error}",
                    remedy="export it one document a line",
                ) from error
            yield f"line {number}", document


def _bson(path: Path, file: _Bytes) -> Iterator[tuple[str, dict[str, Any]]]:
    try:
        from bson import decode
        from bson.errors import BSONError
    except ImportError as error:
        remedy = "pip install 'mindstage[episodes]', or convert it with bsondump"
        raise EpisodeFileError(str(path), cause="pymongo is not installed", remedy=remedy) from error
    options = _codec_options()
    number, at = 0, 0
    while head := file.read(4):
        number += 1
        place = f"document {number}, at byte {at},"
        size = struct.unpack("<i", head)[0] if len(head) == 4 else 0
        if len(head) == 4 and not 5 <= size <= _MAX_DOCUMENT_BYTES:
            cause = f"{place} has a length of {size} bytes; one has 5 to {_MAX_DOCUMENT_BYTES}"
            raise EpisodeFileError(str(path), cause=cause)
        data = head + file.read(max(0, size - 4))
        if len(data) != size:
            raise EpisodeFileError(str(path), cause=f"{place} is cut off: the file ends after {len(data)} bytes of it")
        try:
            document = decode(data, options)
        except (BSONError, ValueError, OverflowError) as error:
            raise EpisodeFileError(str(path), cause=f"{place} is no BSON document: {error}") from error
        yield place.rstrip(","), document
        at += size


def _codec_options() -> CodecOptions[dict[str, Any]]:
    """Dates beyond those of Python and decimal numbers stay exact, and have the form that they have in JSON."""
    from bson.codec_options import CodecOptions, DatetimeConversion, TypeDecoder, TypeRegistry
    from bson.datetime_ms import DatetimeMS
    from bson.decimal128 import Decimal128

    class Date(TypeDecoder):
        bson_type = DatetimeMS

        def transform_bson(self, value: DatetimeMS) -> dict[str, int]:
            return {"$date": int(value)}

    class Decimal(TypeDecoder):
        bson_type = Decimal128

        def transform_bson(self, value: Decimal128) -> dict[str, str]:
            return {"$numberDecimal": str(value)}

    registry = TypeRegistry([Date(), Decimal()])
    return CodecOptions(type_registry=registry, datetime_conversion=DatetimeConversion.DATETIME_MS)
