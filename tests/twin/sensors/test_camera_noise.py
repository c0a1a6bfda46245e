"""The camera's noise: mean and variance of the linear camera model, cheap but not repeating."""

import numpy as np
import pytest

from trackers.observations import Image
from twin.sensors.camera import CAMERA_NOISE, CameraNoise, NoiseBank


def frames(noise: CameraNoise, grey: int, count: int = 2, size: int = 200) -> list[np.ndarray]:
    ideal = Image("camera", 7, np.full((size, size, 3), grey, dtype=np.uint8))
    rng, state, out = np.random.default_rng(3), None, []
    for _ in range(count):
        noisy, state = noise.corrupt(ideal, state, rng)
        assert (noisy.sensor, noisy.stamp_ns, noisy.rgb.dtype, noisy.rgb.shape) == (
            "camera",
            7,
            np.uint8,
            (size, size, 3),
        )
        out.append(noisy.rgb)
    assert (ideal.rgb == grey).all()
    return out


@pytest.mark.parametrize("grey", [40, 128, 220])
@pytest.mark.parametrize("noise", [CameraNoise(read_sigma=3), CameraNoise(shot=0.2), CAMERA_NOISE["default"]])
def test_mean_and_variance_are_those_of_the_model(noise: CameraNoise, grey: int):
    (rgb, _) = frames(noise, grey)
    assert rgb.mean() == pytest.approx(grey, abs=0.1)
    # Rounding to whole grey values adds 1/12.
    expected = noise.read_sigma**2 + noise.shot * grey + 1 / 12
    assert rgb.var() == pytest.approx(expected, rel=0.05)
    channels = rgb.reshape(-1, 3).astype(float)
    assert np.abs(np.corrcoef(channels.T)[np.triu_indices(3, 1)]).max() < 0.03


def test_frames_are_independent():
    first, second, third = frames(CameraNoise(read_sigma=4), 128, count=3)
    for one, other in ((first, second), (second, third), (first, third)):
        a, b = one.astype(float).ravel() - 128, other.astype(float).ravel() - 128
        assert abs(np.corrcoef(a, b)[0, 1]) < 0.02


def test_saturation_holds_at_both_ends():
    dark, _ = frames(CameraNoise(read_sigma=5), 0)
    light, _ = frames(CameraNoise(read_sigma=5), 255)
    assert dark.max() < 40
    assert light.min() > 215


def test_exposure_scales_before_the_noise():
    (darker, _) = frames(CameraNoise(exposure_gain=0.5), 200)
    assert (darker == 100).all()
    (clipped, _) = frames(CameraNoise(exposure_gain=2.0), 200)
    assert (clipped == 255).all()
    (noisy, _) = frames(CameraNoise(exposure_gain=0.5, shot=0.2), 200)
    assert noisy.var() == pytest.approx(0.2 * 100 + 1 / 12, rel=0.05)


def test_white_balance_scales_each_channel_after_the_noise():
    (warm, _) = frames(CameraNoise(white_balance=(1.5, 1.0, 0.5), exposure_gain=2.0), 60)
    assert (warm == [180, 120, 60]).all()
    (clipped, _) = frames(CameraNoise(white_balance=(1.0, 0.5, 1.0), exposure_gain=4.0), 100)
    assert (clipped == [255, 128, 255]).all(), "light that saturated stays lost"
    (noisy, _) = frames(CameraNoise(read_sigma=3, white_balance=(3.0, 1.0, 1.0)), 50)
    assert noisy[..., 0].std() == pytest.approx(3 * noisy[..., 1].std(), rel=0.05)


def test_off_is_off():
    assert CAMERA_NOISE["off"].is_off
    (same, _) = frames(CameraNoise(), 90)
    assert (same == 90).all()


def test_the_strongest_noise_fits_its_fixed_point():
    strongest = CameraNoise(read_sigma=10, shot=1)
    (rgb, _) = frames(strongest, 128, size=400)
    assert rgb.std() == pytest.approx(np.sqrt(100 + 128), rel=0.03)


def test_the_bank_is_drawn_once():
    rng = np.random.default_rng(0)
    ideal = Image("camera", 0, np.zeros((20, 30, 3), dtype=np.uint8))
    noise = CAMERA_NOISE["default"]
    _, first = noise.corrupt(ideal, None, rng)
    _, second = noise.corrupt(ideal, first, rng)
    assert isinstance(first, NoiseBank)
    assert second is first
