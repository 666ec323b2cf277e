"""A cube depends only on the modules that its job imports and on the user's own function."""

import importlib
import pickle
import subprocess
import sys
from functools import partial
from pathlib import Path

import cloudpickle
import numpy as np
import pytest

import nasm
import pipeline
from nasm import maps
from pipeline import store
from pipeline.cubes import escape
from pipeline.provenance import EVERYTHING, ByValue, code_of, sources
from pipeline.provenance.own_code import identify
from pipeline.sweep.sweep import _complaint

ROOT = Path(__file__).parents[1]
SCALE = 2.0


@pytest.fixture
def edited(monkeypatch):
    """Return a function that replaces a module's text and clears the caches that depend on it."""

    def edit(module, text=b"x = 1"):
        monkeypatch.setitem(sources._SOURCES, module, text)
        forget()

    def forget():
        for cached in sources.digest, sources.closure, sources._imported:
            cached.cache_clear()

    yield edit
    monkeypatch.undo()
    forget()


def strength(kappa):
    """Return twice the strength of the first kick; raise an error if the strength exceeds 1/2."""
    if kappa[0] > 0.5:
        raise ArithmeticError("too strong")
    return SCALE * maps.forcing(kappa)[0]


def job(**how):
    return pipeline.over_plane(strength, "two-kicks", "0:1:4", "0:1:4", tile=2, **how)


def attempt(here, out):
    """Fill a cube in which two of four tiles fail; return the error."""
    with pytest.raises((pipeline.TilesFailed, pipeline.Refused)) as error:
        pipeline.fill(job(), out, here(), progress=False)
    return error.value


def test_a_new_module_of_nasm_does_not_invalidate_existing_cubes(here, tmp_path, edited):
    assert len(attempt(here, tmp_path).failed) == 2
    for module in "nasm.new", "nasm.circles.new", "pipeline.cubes.new", "nasm.barriers":
        edited(module)  # the last module exists, but the function does not use it
        assert len(attempt(here, tmp_path).failed) == 2


def test_a_cube_is_refused_when_a_module_that_its_job_imports_has_changed(here, tmp_path, edited):
    attempt(here, tmp_path)
    edited("nasm.maps", b"from nasm import types")
    refused = attempt(here, tmp_path)
    assert isinstance(refused, pipeline.Refused)
    assert "was computed by mathematics" in str(refused)


def test_a_worker_whose_files_differ_is_rejected_if_the_job_needs_them(tmp_path, edited):
    place, plan = store.place_of(tmp_path), job()
    store.create(place, plan.cube, driver := plan.code.computed_by)
    ask = partial(_complaint, place, "strength", plan.cube.config_hash, plan.code)
    assert ask(driver) == ""
    edited("nasm.flux")
    assert ask(driver) == ""
    edited("nasm.maps")
    assert ask(driver).startswith("has mathematics ")


def test_each_job_depends_on_what_it_imports():
    of_escape = pipeline.escape(n_max=10).code
    assert {"nasm.escape", "nasm.maps", "nasm.arithmetic.lanes"} <= {*of_escape.modules}
    assert not {"nasm.barriers", "nasm.flux", "nasm.tori.newton"} & {*of_escape.modules}
    assert of_escape.own == ""
    of_barrier = pipeline.last_barrier(30).code
    assert {"nasm.barriers", "nasm.circles.newton", "nasm.periodic"} <= {*of_barrier.modules}
    assert not {"nasm.flux", "nasm.proofs.bracket"} & {*of_barrier.modules}
    assert of_barrier.computed_by != of_escape.computed_by


@pytest.mark.parametrize("module", ["pipeline.cubes.escape", "pipeline.cubes.rotating_maps"])
def test_the_closure_contains_all_that_python_imports(module):
    asks = (
        f"import sys, {module}; print(*[n for n in sys.modules if n.startswith(('nasm', 'pip'))])"
    )
    result = subprocess.run([sys.executable, "-c", asks], cwd=ROOT, capture_output=True, text=True)
    loaded = {name for name in result.stdout.split() if name in sources._SOURCES}
    assert loaded - {*sources.closure((module,))} <= {"pipeline.cubes"}
    assert len(loaded) > 10


@pytest.mark.parametrize(
    ("text", "found", "not_found"),
    [
        ("import nasm\nnasm.parse('gamma')", "nasm.numbers", "nasm.barriers"),
        ("import nasm.tori\nnasm.tori.graph", "nasm.tori.newton", "nasm.tori.last_torus"),
        ("from nasm import tori as t\ndef f(): t.upper_scale", "nasm.tori.last_torus", "nasm.flux"),
        ("def f():\n    from nasm.circles import graph", "nasm.circles.newton", "nasm.tori"),
        ("import nasm as n\ngetattr(n, 'flux')", "nasm.flux", "pipeline.cubes.escape"),
        ("from pipeline.cubes import cube", "pipeline.cubes.cube", "pipeline.cubes.escape"),
    ],
)
def test_names_are_followed_to_their_modules(edited, text, found, not_found):
    edited("nasm.new", text.encode())
    modules = sources.closure(("nasm.new",))
    assert found in modules
    assert not_found not in modules


OWN = '''
import numpy as np
from helper import weight

FACTOR = 2

def inner(x):
    return x + 1

def outer(kappa):
    """The answer."""
    return FACTOR * inner(kappa.sum()) * weight

def unused():
    return 0
'''
CHANGES = {
    "a constant": ("own", "FACTOR = 2", "FACTOR = 3", True),
    "what it calls": ("own", "x + 1", "x + 2", True),
    "its own text": ("own", "* weight", "/ weight", True),
    "a number of another module": ("helper", "weight = 1", "weight = 2", True),
    "a comment": ("own", "    return FACTOR", "    # twice\n    return FACTOR", False),
    "another function": ("own", "return 0", "return 1", False),
}


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """Return a function that writes a user's own modules to a folder and imports them afresh."""
    monkeypatch.syspath_prepend(tmp_path)
    texts = {"own": OWN, "helper": "weight = 1\n"}

    def load(**changed):
        for name, text in (texts | changed).items():
            (tmp_path / f"{name}.py").write_text(text)
        importlib.invalidate_caches()
        for name in texts:
            sys.modules.pop(name, None)
            for cached in tmp_path.glob("__pycache__/*"):
                cached.unlink()
        return importlib.import_module("own")

    yield load
    for name in texts:
        sys.modules.pop(name, None)


@pytest.mark.parametrize("change", CHANGES)
def test_a_function_is_identified_by_what_it_computes(modules, change):
    name, old, new, matters = CHANGES[change]
    text = {"own": OWN, "helper": "weight = 1\n"}[name]
    before = code_of(modules().outer).own
    assert before == code_of(modules().outer).own
    assert (code_of(modules(**{name: text.replace(old, new)}).outer).own != before) == matters


def test_a_user_defined_function_is_pickled_with_its_modules(modules, tmp_path):
    sent = tmp_path / "sent"
    sent.write_bytes(cloudpickle.dumps(ByValue(modules(helper="weight = 4\n").outer)))
    asks = f"import pickle, numpy; print(pickle.load(open({str(sent)!r}, 'rb'))(numpy.ones(2)))"
    result = subprocess.run([sys.executable, "-c", asks], cwd=ROOT, capture_output=True, text=True)
    assert result.stdout == "24.0\n", result.stderr
    assert cloudpickle.list_registry_pickle_by_value() == set()


def scaled(scale, kappa):
    return scale * kappa.sum()


def closed_over(scale):
    def inside(kappa):
        return scale * kappa.sum()

    return inside


class Scaling:
    def __init__(self, scale):
        self.scale = scale

    def apply(self, kappa):
        return scaled(self.scale, kappa)


def with_default(scale):
    def inside(kappa, scale=scale):
        return scaled(scale, kappa)

    return inside


def test_values_bound_to_a_function_are_part_of_its_identity():
    by_partial, by_method = (lambda s: partial(scaled, s)), (lambda s: Scaling(s).apply)
    for make in closed_over, by_partial, by_method, with_default:
        one, same, other = (code_of(make(scale)) for scale in (1, 1, 2))
        assert one == same
        assert one.own != other.own


def test_a_function_that_cannot_be_identified_is_refused():
    with pytest.raises(ValueError, match="cannot be read; define it with def"):
        code_of(eval("lambda kappa: 1.0"))
    lock = __import__("threading").Lock()
    with pytest.raises(ValueError, match=r"lock=.* cannot be stored"):
        code_of(lambda kappa: lock.locked())


def test_a_function_of_nasm_is_identified_by_its_modules():
    code = code_of(escape.times_of)
    assert (code.own, "nasm.escape" in code.modules) == ("", True)
    assert "nasm.maps" in code_of(strength).modules
    assert identify(strength)[1] >= {"nasm.maps.forcing"}
    assert pickle.loads(pickle.dumps(code)) == code


def test_everything_means_all_files_of_nasm_and_of_the_cubes():
    files = [*Path(nasm.__file__).parent.rglob("*.py"), *(ROOT / "pipeline/cubes").rglob("*.py")]
    assert len(EVERYTHING.modules) == len(files)


def tuple_of(kappa):
    return kappa[0], np.float32(kappa[1])


def test_a_function_that_returns_several_numbers_fills_several_variables(here, tmp_path):
    names = {"kick": "first", "kick_too": "second"}
    plan = pipeline.over_plane(tuple_of, "three-kicks:0.2", "0:1:3", "0:1:2", names)
    cube = pipeline.fill(plan, tmp_path, here(), progress=False)
    assert cube.kick.dims == ("kappa2", "kappa1")
    np.testing.assert_array_equal(cube.kick, np.broadcast_to(cube.kappa1, (2, 3)))
    assert (cube.kick_too.isel(kappa2=1) == np.float32(cube.kappa2[1])).all()
    plan = pipeline.over_plane(tuple_of, "two-kicks", "0:1:3", "0:1:2", {"kick": "first"})
    with pytest.raises(pipeline.TilesFailed, match="must return one number for each of kick"):
        pipeline.fill(plan, tmp_path / "other", here(), progress=False)


def test_a_changed_function_is_refused_even_for_a_complete_cube(here, tmp_path):
    def fill(scale):
        plan = pipeline.over_plane(closed_over(scale), "two-kicks", "0:1:2", "0:1:2")
        return pipeline.fill(plan, tmp_path, here(), progress=False)

    assert fill(1).inside.equals(fill(1).inside)
    with pytest.raises(pipeline.Refused, match="function is closed_over"):
        fill(2)
