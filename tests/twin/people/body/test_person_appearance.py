"""The scenario's description of a person: defaults that work, errors that teach."""

from __future__ import annotations

from colorsys import rgb_to_hsv
from dataclasses import asdict

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from trackers.cameras import CameraGroup
from trackers.likelihood.stereo_head import StereoHeadOptions
from trackers.observations import DepthImage
from trackers.rig import placed_camera
from trackers.vision.head_colours import load_head_model
from trackers.vision.head_outlines import inner_points, outlines
from twin import Simulation, load_scenario, truth_table
from twin.people.body.appearance import appearance_of
from twin.scenario.behaviour import Walk, Wander
from twin.scenario.person import Person, wardrobe

PAPER_SHIRTS = ("white", "black", "pink", "blue", "purple")


def test_everything_has_a_default():
    assert Person().script == (Wander(),)


@pytest.mark.parametrize("shirt", [*PAPER_SHIRTS, "red", "green", "grey", "yellow", "orange", "#12aBcd"])
def test_shirts_by_name_or_number(shirt):
    assert Person(shirt=shirt).shirt == shirt


def test_the_papers_shirts_differ():
    colours = np.array([wardrobe().rgb("shirt", name) for name in PAPER_SHIRTS])
    apart = np.linalg.norm(colours[:, None] - colours, axis=-1) + 9 * np.eye(len(colours))
    assert apart.min() > 0.25


@pytest.mark.parametrize("tone", wardrobe().colours["skin"])
def test_skin_tones_are_those_of_photographs(tone):
    # 5 to 95 % of 6000 skin colours of UCI Skin Segmentation (Bhatt and Dhall), in OpenCV's HSV
    hue, saturation, _ = rgb_to_hsv(*wardrobe().rgb("skin", tone))
    assert 4 <= 180 * hue <= 15
    assert 68 <= 255 * saturation <= 179


def lab(garment, name):
    rgb = np.array(wardrobe().rgb(garment, name), np.float32)
    return cv2.cvtColor(rgb[None, None], cv2.COLOR_RGB2LAB)[0, 0]


@pytest.mark.parametrize(
    ("garment", "name", "measured", "within"),
    [
        # tresses by diffuse reflectance: Scanavez et al., J. Cosmet. Sci. 51 (2000), tables III and IV
        ("hair", "black", (18.0, 0.0, -0.9), 1.5),
        ("hair", "dark-brown", (23.0, 4.0, 4.8), 1.5),
        # Munsell chips matched in daylight: 7.5YR 3/4 and, greying, 7.5YR 5/2, of which ours is the neutral one
        ("hair", "brown", (30.4, 10.6, 21.9), 4.0),
        ("hair", "grey", (51.0, 4.9, 11.1), 15.0),
        # faces by spectrophotometer: Yun et al. (2010); the darkest of five groups of IADR 2009, abstract 120461
        ("skin", "medium", (64.2, 9.0, 18.3), 11.0),
        ("skin", "dark", (26.7, 14.6, 14.7), 5.0),
    ],
)
def test_skin_and_hair_are_as_near_as_stated_to_measured_ones(garment, name, measured, within):
    assert np.linalg.norm(lab(garment, name) - measured) < within


def test_skin_has_a_tone_of_each_typology_angle():
    tones = np.array([lab("skin", tone) for tone in wardrobe().colours["skin"]])
    angle_deg = np.degrees(np.arctan2(tones[:, 0] - 50, tones[:, 2]))  # Chardon et al. (1991)
    assert np.digitize(angle_deg, (55, 41, 28, 10, -30)).tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(("heading_deg", "least", "most"), [(39.5, 0.0, 0.3), (219.5, 0.5, 0.9)])
def test_a_black_haired_head_is_skin_from_the_front_and_hardly_from_behind(heading_deg, least, most):
    # as rendered, with noise, compressed: the share of skin in the head's ellipse (Suzuki et al., eq. 4)
    changes = [f"people.ben={{start: [0.2, -1.75], heading_deg: {heading_deg}, script: {{kind: stand}}}}"]
    changes += [f"sensors.stereo_{k}=null" for k in (2, 3, 4)]
    looks = ["people.ben.skin=fair", "people.ben.hair=black", "people.ben.hair_style=short", "people.ben.cap=none"]
    scenario = load_scenario("head-sequence-2", [*changes, *looks, "sensors.stereo_1.mode=ideal", "duration_s=0.2"])
    truth = []
    with Simulation(scenario, on_truth=truth.append) as simulation:
        image = next(each for each in simulation if isinstance(each, DepthImage))
        camera = placed_camera(simulation.rig.cameras()["stereo_1"])
    first = truth_table(truth)
    head = np.array([first.head_x[0], first.head_y[0], first.head_z[0], first.head_yaw[0]])[:, None, None]
    seen_as = outlines(CameraGroup([camera]), head, StereoHeadOptions().semi_axes_m)
    column, row = (np.rint(each[:, 0]).astype(int) for each in seen_as.pixels(inner_points(200)))
    assert least < load_head_model().skin.shown_in(image.rgb)[row, column].mean() < most


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"shirt": "mauve"}, "no shirt colour 'mauve'; valid are white, black"),
        ({"shirt": "#12345"}, "or '#rrggbb'"),
        ({"trousers": "velvet"}, "no trousers colour 'velvet'"),
        ({"hair_style": "mohawk"}, "no hair style 'mohawk'; valid are short, long, bun, bald"),
        ({"hair_style": "pontail"}, "did you mean 'ponytail'"),
        ({"shirt": "bleu"}, "did you mean 'blue'"),
        ({"shirt_pattern": "tartan"}, "valid are plain, striped, checked, printed"),
        ({"coat": "tweed"}, "no coat colour 'tweed'; valid are beige, black"),
        ({"coat": "tweed"}, "'#rrggbb' or 'none'"),
        ({"bag": "suitcase"}, "valid are none, backpack, shoulder, handbag"),
        ({"bag_colour": "tartan"}, "no bag colour 'tartan'"),
        ({"mass_kg": 3}, "greater than or equal to 8"),
        ({"height_m": -1.7}, "greater than or equal to 0.9"),
        ({"height_m": 2.5}, "less than or equal to 2.1"),
        ({"height": 1.7}, "Extra inputs"),
        ({"heading_deg": float("nan")}, "finite"),
        ({"start": [1, float("inf")]}, "finite"),
        ({"script": {"kind": "fly"}}, "'wander', 'stand', 'walk'"),
        ({"script": {"kind": "walk", "waypoints": []}}, "at least 1"),
        ({"script": {"kind": "walk", "waypoints": [[0, 1]], "speed_m_s": 3.0}}, "less than or equal to 2.5"),
        ({"script": {"kind": "wander", "speed_m_s": [1.2, 0.4]}}, "the smaller number first"),
        ({"script": {"kind": "wander", "stop_s": [-1, 0.4]}}, "the smaller number first"),
        ({"script": {"kind": "wander", "stop_share": 1.5}}, "less than or equal to 1"),
    ],
)
def test_what_is_wrong_is_said_with_what_would_be_right(fields, expected):
    with pytest.raises(ValidationError) as error:
        Person.model_validate(fields)
    assert expected in str(error.value)


def test_scripts_are_told_apart_by_kind():
    person = Person.model_validate({"script": {"kind": "walk", "waypoints": [[0, 1], [1, 2]], "repeat": True}})
    assert person.script == (Walk(waypoints=((0, 1), (1, 2)), repeat=True),)


@pytest.mark.parametrize(
    "named",
    [
        {"shirt": "pink"},
        {"coat": "black"},
        {"skirt": "red"},
        {"cap": "none"},
        {"hair_style": "bob"},
        {"bag": "handbag"},
    ],
)
@pytest.mark.parametrize("seed", range(6))
def test_naming_one_garment_changes_no_other_but_what_would_hide_it(named, seed):
    plain = appearance_of(Person(), np.random.default_rng(seed))
    dressed = appearance_of(Person(**named), np.random.default_rng(seed))
    allowed = set(named)
    if "shirt" in named:
        allowed |= {"shirt_pattern", "shirt_second", "coat", "bag"}
    if "skirt" in named or "hair_style" in named:
        allowed |= {"beard"}
    changed = {name for name, look in asdict(plain).items() if look != getattr(dressed, name)}
    assert changed <= allowed


def test_a_named_shirt_is_seen():
    for seed in range(60):
        looks = appearance_of(Person(shirt="white"), np.random.default_rng(seed))
        assert looks.shirt == wardrobe().rgb("shirt", "white")
        assert looks.shirt_pattern == "plain"
        assert looks.coat is None
        assert looks.bag == "none"


def test_the_same_seed_gives_the_same_looks():
    for seed in range(10):
        first, second = (appearance_of(Person(), np.random.default_rng(seed)) for _ in range(2))
        assert first == second


def test_drawn_looks_are_adults_of_many_kinds():
    drawn = [appearance_of(Person(), np.random.default_rng(seed)) for seed in range(300)]
    assert all(1.5 <= looks.height_m <= 1.9 and not looks.child for looks in drawn)
    assert len({looks.skin for looks in drawn}) >= 6
    available = wardrobe()
    assert {looks.hair_style for looks in drawn} == set(available.choices["hair_style"])
    assert {looks.shirt_pattern for looks in drawn} == set(available.choices["shirt_pattern"])
    assert {looks.bag for looks in drawn} == set(available.choices["bag"])
    for extra in ("skirt", "coat", "cap", "glasses", "beard"):
        assert {bool(getattr(looks, extra)) for looks in drawn} == {False, True}
    assert not any(looks.beard and looks.skirt for looks in drawn)
    for looks in drawn:
        assert np.linalg.norm(np.subtract(looks.shirt, looks.shirt_second)) > 0.4


def test_leggings_are_trousers_named_with_a_skirt():
    assert not appearance_of(Person(skirt="red"), np.random.default_rng(0)).leggings
    assert appearance_of(Person(skirt="red", trousers="black"), np.random.default_rng(0)).leggings
    assert all(appearance_of(Person(trousers="black"), np.random.default_rng(seed)).skirt is None for seed in range(40))


@pytest.mark.parametrize(
    ("fields", "low", "high"),
    [
        ({"height_m": 1.75, "build": 1.0}, 66, 72),
        ({"height_m": 1.84, "build": 1.35}, 120, 150),
        ({"height_m": 1.10, "build": 1.0}, 17, 22),
        ({"height_m": 1.30, "build": 1.0, "child": False}, 35, 42),
        ({"mass_kg": 81.5}, 81.5, 81.5),
    ],
)
def test_mass_follows_height_and_build_unless_named(fields, low, high):
    assert low <= appearance_of(Person(**fields), np.random.default_rng(0)).mass_kg <= high


def test_short_people_are_children_unless_said_otherwise():
    rng = np.random.default_rng
    assert appearance_of(Person(height_m=1.2), rng(0)).child
    assert not appearance_of(Person(height_m=1.2, child=False), rng(0)).child
    assert appearance_of(Person(height_m=1.5, child=True), rng(0)).child
