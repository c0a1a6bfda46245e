"""Evaluators on Dask workers: the same bits as here, whatever order they answer in, and what is lost with a worker."""

from __future__ import annotations

import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from distributed import Client, LocalCluster
from synthetic_meeting import empty_room, observe, rig, walks

from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.presets import make_tracker
from trackers.rgbd_head.evaluators import Evaluator, ScheduledEvaluators
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.tracks import TrackFrame

RIG, ROOM = rig(), empty_room(rig())
SEEN = observe(RIG, walks(3, 12))


@pytest.fixture(scope="module")
def threads() -> Iterator[Any]:
    """A scheduler with four workers in this process."""
    with LocalCluster(n_workers=4, processes=False, dashboard_address="127.0.0.1:0", silence_logs=50) as cluster:
        yield cluster


def made(scheduler: str | None = None, room=ROOM, on=RIG, **options) -> Any:
    given = {"heads": 256, **options, "scheduler": scheduler}
    return make_tracker("rgbd-head", on, room, np.random.default_rng(0), given)


def followed(tracker: Any, seen=SEEN) -> list[TrackFrame]:
    return list(track_frames(tracker, RIG, seen))


@pytest.mark.parametrize("room", [ROOM, ()], ids=["", "learned background"])
def test_tracks_are_the_local_ones_to_the_bit_whatever_order_answers_come_in(threads, room, monkeypatch):
    delays, rng = [], np.random.default_rng(5)

    def slow(function):
        def later(*arguments):
            delays.append(rng.uniform(0, 0.004))
            time.sleep(delays[-1])
            return function(*arguments)

        return later

    expected = repr(followed(made(room=room)))
    for name in ("take", "expect", "log_likelihood", "facing", "silhouettes_off_rad", "colours_on", "unassigned"):
        monkeypatch.setattr(Evaluator, name, slow(getattr(Evaluator, name)))
    tracker = made(threads.scheduler_address, room)
    assert repr(followed(tracker)) == expected
    assert not tracker.warnings[1:] and len(delays) > 100


def test_a_picture_travels_once_and_little_beside_it(threads, monkeypatch):
    """One person, a moment of four pictures, as many hypotheses and layers as there are by default."""
    sent: list[tuple[str, int]] = []
    ask = ScheduledEvaluators._ask

    def counted(self, what, arguments):
        answers = ask(self, what, arguments)
        back = answers.values() if what != "take" else ()
        sent.append((what, sum(len(pickle.dumps(each)) for each in (*arguments.values(), *back))))
        return answers

    monkeypatch.setattr(ScheduledEvaluators, "_ask", counted)
    seen = observe(RIG, walks(1, 12))
    followed(made(threads.scheduler_address, heads=RgbdHeadOptions().heads), seen)
    per_picture = 160 * 120 * (3 + 4)
    taken = [size for what, size in sent if what == "take"]
    assert len(taken) == 12 and max(taken) < 4 * (per_picture + 1024)
    moments: list[int] = []
    for what, size in sent:
        moments = [*moments, 0] if what == "take" else [*moments[:-1], moments[-1] + size]
    assert 0 < max(moments) <= 128 * 1024, "bytes a moment beyond its pictures"


def test_a_worker_that_dies_is_taken_over_with_the_same_bits(threads, monkeypatch):
    expected, asked = repr(followed(made())), []

    def dying(self, heads):
        asked.append(self)
        if len(asked) > 12 and self is asked[0]:
            raise OSError("gone")
        return weights(self, heads)

    weights = Evaluator.log_likelihood
    tracker = made(threads.scheduler_address)
    monkeypatch.setattr(Evaluator, "log_likelihood", dying)
    assert repr(followed(tracker)) == expected
    assert [each for each in tracker.warnings if "was lost; its pictures are weighed here" in each]


@pytest.mark.slow
def test_a_worker_process_that_is_killed_is_taken_over_with_the_same_bits():
    on, seen = rig(2), [each for each in SEEN if each.sensor in rig(2).sensors]
    room = [each for each in ROOM if each.sensor in on.sensors]
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50, memory_limit=0
    ) as cluster:
        tracker, frames = made(cluster.scheduler_address, room, on), []
        for k, each in enumerate(seen):
            if k == 13:
                with Client(cluster.scheduler_address, set_as_default=False) as client:
                    first = min(client.scheduler_info(n_workers=-1)["workers"])
                    nanny = next(each for each in cluster.workers.values() if each.worker_address == first)
                    nanny.auto_restart = False  # nothing is asked of another one
                    nanny.process.process.kill()
            frames += tracker.update(each)
        frames += tracker.finish()
    assert repr(frames) == repr(followed(made(room=room, on=on), seen))
    assert tracker.warnings[1:] == ["the Dask worker of stereo_1 was lost; its pictures are weighed here"]


def test_schedulers_that_cannot_be_used_are_told(threads, monkeypatch):
    monkeypatch.setattr("trackers.scheduler._CONNECT_S", 0.2)
    with pytest.raises(InputError, match=r"^tracker rgbd-head: scheduler: tcp://127.0.0.1:9: nobody answers there"):
        made("tcp://127.0.0.1:9")
    five = {f"stereo_{k}": RIG.sensors[f"stereo_{min(k, 4)}"] for k in range(1, 6)}
    with pytest.raises(InputError, match=r"has 4 workers for 5 cameras; one for each is expected$"):
        make_tracker(
            "rgbd-head", RIG.model_copy(update={"sensors": five}), options={"scheduler": threads.scheduler_address}
        )


def test_a_picture_of_another_size_is_told_from_a_worker_too(threads):
    image = SEEN[0]
    wrong = type(image)(image.sensor, image.stamp_ns, image.rgb[:60, :80], image.depth_m[:60, :80])
    with pytest.raises(InputError, match="image of 'stereo_1' has shape"):
        followed(made(threads.scheduler_address), [wrong, *SEEN[1:]])


def test_dask_is_loaded_where_it_is_asked_for_alone():
    code = "import sys, trackers.rgbd_head.tracker, trackers.presets; assert not {'dask', 'distributed'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
