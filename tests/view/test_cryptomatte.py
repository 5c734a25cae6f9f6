"""Cryptomatte against its specification: published hashes, and coverage that is counted by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.view.scenes import SUN, floor, looking_down, quad, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.cryptomatte import Mattes, id_bits, metadata_of, murmur3


# Published vectors of MurmurHash3_x86_32 with seed 0, of every length modulo 4.
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", 0x00000000),
        ("test", 0xBA6BD213),
        ("Hello, world!", 0xC0363E43),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_hashes_are_murmurs(text, value):
    assert murmur3(text) == value


def test_the_key_is_the_one_that_other_programs_use_for_objects():
    assert metadata_of(["/A"])["cryptomatte/3ae39a5/name"] == "CryptoObject"


def test_bits_are_those_of_a_finite_normal_float():
    bits = np.array([id_bits(f"/World/Thing{k}") for k in range(20000)], np.uint32)
    exponents = bits >> 23 & 0xFF
    assert exponents.min() > 0 and exponents.max() < 255
    # Without the rule some would not be: one hash of 128.
    plain = np.array([murmur3(f"/World/Thing{k}") >> 23 & 0xFF for k in range(20000)])
    assert ((plain == 0) | (plain == 255)).any()


def test_the_manifest_names_objects_by_their_hashes():
    manifest = json.loads(metadata_of(["/World/Wände", "/A", "/A"])["cryptomatte/3ae39a5/manifest"])
    assert manifest == {"/A": f"{id_bits('/A'):08x}", "/World/Wände": f"{id_bits('/World/Wände'):08x}"}


def bits_of(channel: np.ndarray) -> np.ndarray:
    return channel.view(np.uint32)


def test_ranks_go_by_coverage_and_sum_over_passes():
    paths = ("/A", "/B", "/C")
    mattes = Mattes(3, paths)
    mattes.add(np.array([0, 0, 0, 2]), np.array([0, 1, 1, 2]), 0.5)
    mattes.add(np.array([0, 2]), np.array([0, 2]), 1.5)
    channels = mattes.channels(0.25)
    first, second = bits_of(channels["CryptoObject00.r"]), bits_of(channels["CryptoObject00.b"])
    assert list(first) == [id_bits("/A"), 0, id_bits("/C")] and list(second) == [id_bits("/B"), 0, 0]
    np.testing.assert_allclose(channels["CryptoObject00.g"], [0.5, 0.0, 0.5])
    np.testing.assert_allclose(channels["CryptoObject00.a"], [0.25, 0.0, 0.0])
    assert not channels["CryptoObject02.r"].any()


def test_a_picture_is_covered_by_what_is_seen():
    # A card over the left half of the floor, whose edge runs through the middle of the pixels of one column.
    edge = 0.1
    source = steady([floor(), quad("/card", (-3, -3), (edge, 3), 0.5)], (SUN,), looking_down())
    settings = Settings(photons=64, threads=1, aovs=("cryptomatte", "id"), samples=16)
    channels = render_frame(RenderContext(source, settings), Shutter(0, 0, 0), 16, 16).channels
    assert {name for name in channels if name.startswith("Crypto")} == {
        f"CryptoObject0{layer}.{c}" for layer in range(3) for c in "rgba"
    }
    covered = {path: np.zeros((16, 16)) for path in ("/floor", "/card")}
    for layer in range(3):
        for hashed, cover in ("rg", "ba"):
            for path, plane in covered.items():
                own = bits_of(channels[f"CryptoObject0{layer}.{hashed}"]) == id_bits(path)
                plane[own] += channels[f"CryptoObject0{layer}.{cover}"][own]
    np.testing.assert_allclose(sum(covered.values()), channels["A"], atol=1e-6)
    assert (covered["/card"][:, 0] == 1.0).all() and (covered["/floor"][:, -1] == 1.0).all()
    mixed = (covered["/card"] > 0) & (covered["/floor"] > 0)
    assert mixed.any(axis=1).all() and mixed.sum() <= 16
