"""Certificates of what a cube calls proved, a file for each tile; see nasm/proofs/README.md."""

import json
import lzma
from io import BytesIO
from itertools import chain, repeat


def packed(proofs):
    """Return what a tile keeps beside its arrays: the certificates of those that are proved.

    They are compressed one by one, as those of cells take much memory.
    """
    proved, data = [proof for proof in proofs if proof and proof.proved], BytesIO()
    if not proved:
        return {}
    with lzma.open(data, "wt", preset=0) as file:
        for separator, proof in zip(chain("[", repeat(",")), proved, strict=False):
            file.write(separator + json.dumps(proof.certificate()))
        file.write("]")
    return {"certificates": data.getvalue()}


def unpacked(data):
    """Return the list of certificates, objects all; ValueError if the bytes are damaged."""
    try:
        found = json.loads(lzma.decompress(data)) if data else []
    except (lzma.LZMAError, EOFError, RecursionError) as error:
        raise ValueError(str(error)) from None
    if not (isinstance(found, list) and all(isinstance(item, dict) for item in found)):
        raise ValueError("they are no list of objects")
    return found


def of_certificate(certificate, field):
    """Return a row of numbers in a certificate as a tuple of floats."""
    return tuple(map(float.fromhex, certificate[field]))


def seconds_to_check(certificate):
    """Return the CPU seconds, about, that the checker will take."""
    if "lives" in certificate:
        return 7e-5 * sum(certificate["lives"])
    degrees = certificate["moves"]["numbers"]
    first = degrees[0]
    size, across = max(len(part) for row in first[0] for part in row), len(first)
    nodes = len(degrees) * (across + 1 if across > 1 else 1)
    inverses = 240 if across > 1 else 30 if "scales" in certificate else 4
    return 1e-4 * len(first[0]) * size * (nodes + inverses)
