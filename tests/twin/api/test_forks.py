"""Processes forked after a run with images go on drawing, with the same pixels, or say that they cannot: none hangs."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")

_PREPARE = """
import hashlib, multiprocessing, os, signal, sys, tempfile, threading, time, warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
import numpy as np
import twin

warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12's, of forks beside threads
SMALL = ["duration_s=0.3", "background_frames=1", "people=null", "people.ann={}", "sensors.fisheye.size=[96, 96]"]
SCENARIO = twin.load_scenario("lab-five-people", SMALL)
HERE = os.getpid()

def told(what):
    print(what, flush=True)

def digest(observations):
    content = hashlib.sha256()
    for each in observations:
        for name in ("rgb", "ranges_m"):
            content.update(np.ascontiguousarray(getattr(each, name, ())).tobytes())
    return content.hexdigest()

def run(number=0):
    with twin.Simulation(SCENARIO) as simulation:
        return digest(simulation)

def check(child):
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert ended == 7, ended

def in_child(work):
    child = os.fork()
    if child == 0:
        signal.alarm(120)  # hung; a loaded machine takes its time
        work()
        sys.exit(7)  # not os._exit: what is registered for the end of Python must not hang either
    check(child)
"""

CHILDREN = {
    "from one thread": """
        first = run()

        told("a new simulation")
        def work():
            assert run() == first
        in_child(work)
        assert run() == first

        told("a child's child")
        in_child(lambda: in_child(work))

        told("while iterating")
        simulation = twin.Simulation(SCENARIO)
        observations = iter(simulation)
        begun = [next(observations) for _ in range(5)]
        def work():
            assert digest([*begun, *observations]) == first
            simulation.close()
        in_child(work)
        assert digest([*begun, *observations]) == first

        told("nothing drawn in the child")
        simulation = twin.Simulation(SCENARIO)
        next(iter(simulation))
        in_child(lambda: None)

        told("a pool of two")
        with multiprocessing.get_context("fork").Pool(2) as pool:
            assert pool.map(run, range(2), chunksize=1) == [first] * 2
        with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as pool:
            assert list(pool.map(run, range(2))) == [first] * 2

        told("a whole run")
        folder = tempfile.mkdtemp()
        in_child(lambda: twin.run_scenario(SCENARIO, trackers=[], out=folder + "/run"))
        assert os.path.exists(folder + "/run/preview.mp4")
    """,
    "while threads draw": """
        first, stop, drawing = run(), threading.Event(), threading.Event()
        begun = threading.Barrier(3)
        def draw():
            # Renderers that stand: what a thread computes for the first time it may hold a lock of Python 3.11's over.
            with twin.Simulation(SCENARIO) as simulation:
                simulation.look(0)
                begun.wait()
                while not stop.is_set():
                    drawing.wait()
                    simulation.look(0)
                    time.sleep(0.002)
        def fork(*_):
            drawing.set()
            time.sleep(0.02)
            child = os.fork()
            if child == 0:
                signal.alarm(120)  # hung; a loaded machine takes its time
                os._exit(7 if run() == first else 3)
            drawing.clear()  # what they draw matters as the child begins
            check(child)

        told("by a thread")
        with ThreadPoolExecutor(1) as thread:
            assert thread.submit(run).result() == first
            thread.submit(fork).result()

        told("beside threads that draw")
        threads = [threading.Thread(target=draw) for _ in range(2)]
        for thread in threads:
            thread.start()
        begun.wait()
        for _ in range(3):
            fork()
        stop.set()
        drawing.set()
        for thread in threads:
            thread.join()
    """,
}
"""Programs, which print what they try: each follows on another in one process, whose renderers have been used by then."""


def in_python(text: str, **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {name: value for name, value in os.environ.items() if name != "LP_NUM_THREADS"}
    program = _PREPARE + textwrap.dedent(text)
    ran = [sys.executable, "-c", program]
    return subprocess.run(ran, capture_output=True, text=True, timeout=280, env={**kept, **environment})


@pytest.mark.slow
@pytest.mark.parametrize("kind", CHILDREN)
def test_forked_process_draws_the_same_and_ends(kind: str) -> None:
    found = in_python(CHILDREN[kind])
    assert found.returncode == 0 and not found.stderr, found.stdout + found.stderr


@pytest.mark.slow
def test_process_forked_from_a_renderer_with_threads_names_spawn() -> None:
    found = in_python(
        """
        simulation = twin.Simulation(SCENARIO)
        simulation.look(0)
        observations = iter(simulation)
        def work():
            for draw in (run, lambda: list(observations)):
                try:
                    draw()
                except twin.InputError as error:
                    assert "spawn" in str(error) and len(str(error).splitlines()) == 1, error
                else:
                    os._exit(3)
            simulation.close()
        in_child(work)
        list(observations)
        """,
        LP_NUM_THREADS="2",
    )
    assert found.returncode == 0 and not found.stderr, found.stderr
