"""Certificates in a store: do they exist, and do they prove what the cubes claim?"""

import sys
import time
from math import inf

import click

from nasm.proofs.certificate_checker import Refuted, check
from pipeline import store
from pipeline.cubes import proved
from pipeline.sweep.progress import Progress, duration, plural

_CUBES = {
    "proved_barrier": proved.uncertified_rays,
    "proved_map": proved.uncertified_cells,
    "proved_triangles": proved.uncertified_triangle,
    "labels_proofs": proved.uncertified_forcing,
}


def verify_proofs(path, place, longest, repair):
    """Compare the cubes with their certificates, and check the certificates.

    Return the number of wrong tiles, and how many of them `repair` can delete. A cube with changed
    metadata is skipped, because its correct tiles might look wrong.

    path : prefix of the names of the cubes.
    longest : limit in seconds; certificates that take longer to check are skipped, but counted.
    repair : True to delete wrong tiles, if the metadata are known to be right.
    """
    n_bad = n_repairable = 0
    for name in sorted(_CUBES.keys() & set(store.names(place))):
        if store.changes(place, name):
            continue
        tiles, bad, is_known = {}, {}, store.has_digests(place, name)
        try:
            committed = list(store.tiles_of(place, name))
        except store.Refused:  # `verify` has already reported the reason
            continue
        for index, tile in committed:
            try:
                certificates = proved.unpack_certificates(
                    place.read(store.certificates_key(name, index))
                )
                if problem := _CUBES[name](tile, certificates):
                    bad[index] = problem
                elif certificates:
                    tiles[index] = list(map(proved.seconds_to_check, certificates))
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
                bad[index] = f"its certificates are damaged: {error}"
        costs = [seconds for of_tile in tiles.values() for seconds in of_tile]
        short = [seconds for seconds in costs if seconds <= longest]
        summary = f"{path}{name}: {plural(len(short), 'certificate')} to check"
        click.echo(f"{summary}, about {duration(sum(short))} of CPU time", err=True)
        with Progress(f"{path}{name}: certificates", sys.stderr) as progress:
            progress.add_work(sum(short))
            for index, of_tile in tiles.items():
                certificates = proved.unpack_certificates(
                    place.read(store.certificates_key(name, index))
                )
                used, wall = time.thread_time(), time.monotonic()
                for certificate, seconds in zip(certificates, of_tile, strict=True):
                    if seconds <= longest:
                        try:
                            check(certificate, max_kicks=inf)  # `longest` limits the time instead
                        except Refuted as reason:
                            bad[index] = f"a certificate is refuted: {reason}"
                predicted = sum(seconds for seconds in of_tile if seconds <= longest)
                used, wall = time.thread_time() - used, time.monotonic() - wall
                progress.advance(predicted, used, wall)
        summary = f"checked {len(short)} of {plural(len(costs), 'certificate')}"
        if len(short) < len(costs):
            summary += (
                f"; the others take {duration(sum(costs) - sum(short))}, see --max-cpu-seconds"
            )
        click.echo(f"{path}{name}: {summary}; wrong: {plural(len(bad), 'tile')}")
        for index, problem in bad.items():
            click.echo(store.printable(f"  tile {index}: {problem}"))
            if repair and is_known:
                store.free(place, name, index)
        n_bad, n_repairable = n_bad + len(bad), n_repairable + len(bad) * is_known
    return n_bad, n_repairable
