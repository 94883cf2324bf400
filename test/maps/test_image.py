# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of map_server: read as it reads them, refused in one line."""

import numpy as np
import pytest
import yaml
from PIL import Image

from sparse_coord_ros.base.errors import MapError
from sparse_coord_ros.lab.maps.image import read_floor_plan

FIELDS = {
    "image": "m.pgm",
    "resolution": 0.1,
    "origin": [-1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
VALUES = np.array([[254, 205, 0], [255, 128, 100]], dtype=np.uint8)


@pytest.fixture
def saved(tmp_path):
    """Return a function that writes a map and reads it."""

    def read(pixels=VALUES, name="m.pgm", **fields):
        if isinstance(pixels, np.ndarray):
            pixels = Image.fromarray(pixels)
        if pixels is not None:
            pixels.save(tmp_path / name)
        said = {**FIELDS, "image": name, **fields}
        said = {key: value for key, value in said.items() if value != "left out"}
        (tmp_path / "m.yaml").write_text(yaml.safe_dump(said))
        return read_floor_plan(tmp_path / "m.yaml")

    return read


def signs(plan):
    """Return a plan as text: . free, # occupied, ? unknown."""
    rows = np.where(plan.free, ".", np.where(plan.occupied, "#", "?"))
    return ["".join(row) for row in rows]


@pytest.mark.parametrize(
    ("fields", "rows"),
    [
        ({}, [".?#", ".?" + "?"]),
        ({"negate": 1}, ["##.", "#??"]),
        ({"occupied_thresh": 0.55}, [".?#", ".?#"]),
        ({"free_thresh": 0.3, "occupied_thresh": 0.49}, ["..#", ".##"]),
        ({"occupied_thresh": "left out", "free_thresh": "left out"}, ["..#", ".??"]),
        ({"mode": "scale"}, [".?#", ".??"]),
        ({"mode": "raw", "occupied_thresh": 0.9}, ["??.", "??#"]),
    ],
)
def test_values_by_negate_thresholds_and_mode(saved, fields, rows):
    plan = saved(**fields)
    assert signs(plan) == rows
    assert (plan.resolution, plan.origin, plan.name) == (0.1, (-1.0, 2.0), "m")


def test_the_thresholds_of_map_server(saved):
    unsaid = {"occupied_thresh": "left out", "free_thresh": "left out"}
    assert signs(saved(np.array([[192, 191, 90, 89]], dtype=np.uint8), **unsaid)) == [
        ".??#"
    ]


def test_kinds_of_images(saved):
    expected = signs(saved())
    assert signs(saved(name="m.png")) == expected
    assert signs(saved(VALUES.astype(np.uint16) * 257, name="m.png")) == expected
    assert signs(saved(VALUES.astype(np.uint16) * 257)) == expected  # 16-bit PGM
    assert (
        signs(saved(Image.fromarray(VALUES).convert("RGB"), name="m.png")) == expected
    )
    assert signs(saved(Image.fromarray(VALUES).convert("P"), name="m.png")) == expected
    black = Image.fromarray(np.array([[True, False]]))
    assert signs(saved(black, name="m.png")) == [".#"]


def test_what_is_not_opaque_is_unknown(saved):
    image = Image.fromarray(VALUES).convert("RGBA")
    image.putalpha(
        Image.fromarray(np.array([[255, 255, 0], [254, 255, 255]], dtype=np.uint8))
    )
    assert signs(saved(image, name="m.png")) == [".??", "???"]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"resolution": -0.05},
            "setting resolution: value is -0.05, allowed: a number from 0.001",
        ),
        ({"resolution": float("nan")}, "setting resolution: value is nan"),
        ({"resolution": "left out"}, "setting resolution: value is None"),
        ({"image": "left out"}, "field 'image' is missing"),
        ({"image": ["m.pgm"]}, "setting image: value is"),
        ({"image": "n.pgm"}, "n.pgm: no such image"),
        ({"image": "m.yaml"}, "cannot be read as an image (its format is unknown)"),
        ({"image": "a\0b"}, "cannot be read as an image"),
        ({"origin": [0, 0, 0.5]}, "has a yaw of 0.5, allowed: 0"),
        ({"origin": [0]}, "field 'origin' is [0]"),
        ({"origin": [0, float("inf"), 0]}, "field 'origin' is"),
        ({"negate": 2}, "setting negate: value is 2, allowed"),
        (
            {"free_thresh": 0.7},
            "setting free_thresh: value is 0.7, allowed: less than occupied_thresh",
        ),
        ({"mode": "grey"}, "setting mode: value is 'grey', allowed: trinary or"),
    ],
)
def test_bad_fields_are_one_line(saved, fields, words):
    with pytest.raises(MapError) as refused:
        saved(**fields)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("image: [[[[[[[[[[[[[[1]]]]]]]]]]]]]]", "setting image: value is [[[[...]]]]"),
        ("image: [", "not readable as YAML"),
        ("", "must be 'key: value' lines"),
        ("image: !!python/object/apply:os.system [ls]\n", "not readable as YAML"),
        (b"\x89PNG\xff", "is no UTF-8 text"),
    ],
)
def test_bad_yaml_is_one_line(tmp_path, text, words):
    path = tmp_path / "m.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(MapError) as refused:
        read_floor_plan(path)
    assert words in str(refused.value)
    assert len(str(refused.value)) < 600


def test_broken_and_huge_images_are_one_line(saved, tmp_path):
    saved()
    whole = (tmp_path / "m.pgm").read_bytes()
    for data, words in (
        (whole[:-3], "cannot be read as an image"),
        (b"", "cannot be read as an image"),
        (b"P5\n20000 20000\n255\n", "has too many pixels"),
        (b"P5\n70000 1\n255\n", "has too many pixels"),
    ):
        (tmp_path / "m.pgm").write_bytes(data)
        with pytest.raises(MapError, match=words):
            read_floor_plan(tmp_path / "m.yaml")


def test_missing_files_are_one_line(tmp_path):
    with pytest.raises(MapError, match="no.yaml"):
        read_floor_plan(tmp_path / "no.yaml")
    (tmp_path / "m.pgm").write_bytes(b"P5\n1 1\n255\n\0")
    with pytest.raises(MapError, match="m.pgm: is an image"):
        read_floor_plan(tmp_path / "m.pgm")
    (tmp_path / "m.yaml").write_text("image: m.pgm\n")
    with pytest.raises(MapError, match=r"belongs to it: .*m\.yaml"):
        read_floor_plan(tmp_path / "m.pgm")
