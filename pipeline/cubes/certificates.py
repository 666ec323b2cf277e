"""Certificates of what a cube calls proved, a file for each tile; see nasm/proofs/README.md."""

import json
import lzma


def packed(proofs):
    """Return what a tile keeps beside its arrays: the certificates of those that are proved."""
    certificates = [proof.certificate() for proof in proofs if proof and proof.proved]
    text = json.dumps(certificates).encode()
    return {"certificates": lzma.compress(text, preset=0)} if certificates else {}


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
    if "scales" in certificate:
        numbers = certificate["moves"]["numbers"]
        size = max(len(part) for row in numbers[0] for part in row)
        return 1e-4 * len(numbers[0]) * size * (len(numbers) + 30)
    if "moves" in certificate:
        degrees = max(map(len, certificate["moves"]["numbers"]))
        return 1.5e-4 * (degrees + 4) ** 2 * len(certificate["centre"][0])
    return 2e-3 * sum(map(len, certificate["modes"]))
