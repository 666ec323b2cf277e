import re
from importlib.metadata import version

from pipeline.provenance import computed_by, digest_of, provenance


def test_provenance_names_versions_and_commit():
    found = provenance()
    assert set(found) >= {"package_version", "git_commit", "library_versions", "created"}
    assert f"numba {version('numba')}, " in found["computed_by"]
    assert re.match(r"mathematics [0-9a-f]{12}, ", found["computed_by"])
    assert computed_by() == found["computed_by"]


def test_the_digest_is_that_of_the_files():
    assert digest_of("nasm/*.py") != digest_of("nasm/*.py", "pipeline/cubes/*.py")
    assert digest_of("nasm/*.py") == digest_of("nasm/*.py")
