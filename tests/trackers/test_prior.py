"""What a tracker may know: one value that trackers written for observations of the empty room alone can take as those."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from box_room import box_room_cloud
from synthetic_room import empty_room, rig

from trackers.environment import build_environment, save_environment
from trackers.errors import InputError
from trackers.observations import Image
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import NO_PRIOR, LaserSensor, PriorFiles, Rig

AREA = ((-1.8, -1.3), (1.8, -1.3), (1.8, 1.3), (-1.8, 1.3))
EMPTY = empty_room(np.random.default_rng(0), 2)
ON = Rig(sensors={"low": LaserSensor(topic="/low/scan")}, area=AREA, room="boxes")


@pytest.fixture(scope="module")
def boxes(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("environment") / "boxes.npz"
    save_environment(build_environment(box_room_cloud(step_deg=1.0), room="boxes", area=AREA), path)
    return path


@pytest.fixture
def plug_in(tmp_path, monkeypatch) -> str:
    (tmp_path / "lab_that_knows.py").write_text(
        "class Mine:\n"
        "    def __init__(self, rig, background, rng, **options): self.given = background\n"
        "    def update(self, observation): return []\n"
        "    def tracks(self): return []\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    return "lab_that_knows:Mine"


@pytest.mark.parametrize(
    "background", [EMPTY, tuple(EMPTY), iter(EMPTY), Prior(EMPTY)], ids=lambda each: type(each).__name__
)
def test_a_tracker_can_use_what_it_is_handed_as_the_list_that_it_was(plug_in, background):
    given = make_tracker(plug_in, rig(), background).given
    assert list(given) == list(given) == EMPTY
    assert len(given) == len(EMPTY) and given[0] is EMPTY[0] and list(given[1:]) == EMPTY[1:]
    assert given.environment is None and given.learned == {}
    assert not make_tracker(plug_in, rig()).given


def test_an_environment_and_what_was_learned_stand_beside(plug_in, boxes):
    prior = Prior.read(EMPTY, PriorFiles(environment=str(boxes), learned={"heads": "/heads.npz"}), ON)
    given = make_tracker(plug_in, rig(), prior).given
    assert given is prior and given.environment.room == "boxes"
    assert given.learned == {"heads": Path("/heads.npz")}


def test_an_environment_of_another_room_or_damaged_is_refused(boxes, tmp_path):
    files = PriorFiles(environment=str(boxes))
    with pytest.raises(InputError, match="is of the room 'boxes'; one of 'lab' is expected"):
        Prior.read((), files, ON.model_copy(update={"room": "lab"}))
    cut = tmp_path / "cut.npz"
    cut.write_bytes(boxes.read_bytes()[:-500])
    with pytest.raises(InputError, match=r"cut\.npz: is not an \.npz, or a damaged one"):
        Prior.read((), PriorFiles(environment=str(cut)), ON)


def test_files_are_relative_to_who_names_them(tmp_path):
    files = PriorFiles(environment="a.npz", learned={"x": "sub/b.npz", "y": "/c.npz"}).within(tmp_path)
    assert files.paths() == {
        "environment": tmp_path / "a.npz",
        "learned.x": tmp_path / "sub/b.npz",
        "learned.y": Path("/c.npz"),
    }
    (tmp_path / "a.npz").touch()
    assert list(files.missing()) == ["learned.x", "learned.y"]
    assert files.without(files.missing()).paths() == {"environment": tmp_path / "a.npz"}
    with pytest.raises(InputError, match=r"who: prior\.learned\.x: there is no file .*b\.npz; .* is expected"):
        files.check("who")


@pytest.mark.parametrize("name", ["a\0b", "n" * 5000, ".", ""])
def test_a_path_that_no_file_can_have_is_a_file_that_is_not_there(name, tmp_path):
    assert list(PriorFiles(environment=name).within(tmp_path).missing()) == ["environment"]


def test_the_digest_follows_the_contents_and_what_they_are_for(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    one.write_bytes(b"1")
    other.write_bytes(b"1")
    digest = PriorFiles(environment=str(one)).digest()
    assert digest == PriorFiles(environment=str(other)).digest() != NO_PRIOR.digest() == ""
    assert digest != PriorFiles(learned={"x": str(one)}).digest()
    one.write_bytes(b"2")
    assert digest != PriorFiles(environment=str(one)).digest()


def test_a_rig_file_names_files_beside_itself_and_one_without_is_written_as_ever(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("sensors: {low: {kind: laser, topic: /scan}}\nprior: {environment: room.npz}\n")
    assert Rig.load(path).prior.environment == str(tmp_path / "room.npz")
    assert "prior" not in ON.dump_yaml()
    path.write_text("sensors: {low: {kind: laser, topic: /scan}}\nprior: {enviroment: room.npz}\n")
    with pytest.raises(InputError, match=r"prior\.enviroment: unknown key; did you mean 'environment'"):
        Rig.load(path)


def test_the_former_key_of_a_rig_is_still_read_and_its_new_name_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("sensors: {low: {kind: laser, topic: /scan}}\nknowledge: {environment: room.npz}\n")
    assert Rig.load(path).prior.environment == str(tmp_path / "room.npz")
    assert "knowledge: is now called 'prior'" in caplog.text


PINHOLE = "sensors: {cam: {kind: camera, topic: /cam, intrinsics: {width: 8, height: 6, fx: 5, fy: 5, cx: 4, cy: 3}}}\n"


def test_a_picture_of_the_empty_room_comes_with_the_rig(tmp_path: Path) -> None:
    rgb = np.zeros((6, 8, 3), np.uint8)
    rgb[..., 0] = 200
    cv2.imwrite(str(tmp_path / "empty.png"), rgb[..., ::-1])
    path = tmp_path / "rig.yaml"
    path.write_text(PINHOLE + "prior: {background: {cam: empty.png}}\n")
    loaded = Rig.load(path)
    recorded = [Image("cam", 5, np.zeros((6, 8, 3), np.uint8)), Image("other", 5, rgb)]
    prior = Prior.read(recorded, loaded.prior, loaded)
    assert [each.sensor for each in prior] == ["other", "cam"]
    picture = prior[1]
    assert isinstance(picture, Image) and (picture.rgb == rgb).all()
    assert loaded.prior.digest() != "" and loaded.prior.without(["background.cam"]) == NO_PRIOR


def test_a_picture_of_the_empty_room_is_not_turned_by_what_its_camera_says_of_itself(tmp_path: Path) -> None:
    grey = np.repeat(np.arange(6, dtype=np.uint8)[:, None] * 40, 8, axis=1)
    jpeg = cv2.imencode(".jpg", np.dstack([grey] * 3))[1].tobytes()
    # EXIF of one entry: orientation 3, upside down
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x03\0\0\0\0\0\0"
    turned = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2) + exif + jpeg[2:]
    (tmp_path / "empty.jpg").write_bytes(turned)
    files = PriorFiles(background={"cam": str(tmp_path / "empty.jpg")})
    (picture,) = Prior.read((), files, Rig.parse(PINHOLE, "rig.yaml"))
    assert isinstance(picture, Image) and picture.rgb[-1].mean() > picture.rgb[0].mean()


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("low", b"", r"prior\.background\.low: 'low' is no camera .* valid are cam"),
        ("cam", b"", r"empty\.png is no picture; a PNG or JPEG of 8 x 6 pixels"),
        ("cam", b"none", r"empty\.png is no picture; a PNG or JPEG of 8 x 6 pixels"),
        ("cam", cv2.imencode(".png", np.zeros((3, 4, 3), np.uint8))[1].tobytes(), r"is 4 x 3 pixels; .* of 8 x 6"),
    ],
)
def test_a_picture_that_cannot_be_the_camera_s_is_refused(
    tmp_path: Path, name: str, content: bytes, expected: str
) -> None:
    (tmp_path / "empty.png").write_bytes(content)
    files = PriorFiles(background={name: str(tmp_path / "empty.png")})
    with pytest.raises(InputError, match=expected):
        Prior.read((), files, Rig.parse(PINHOLE, "rig.yaml"))
