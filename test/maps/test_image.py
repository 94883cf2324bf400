# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of map_server: read as it reads them, refused in one line."""

import math

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
        ({"mode": "Scale", "free_thresh": 0.15}, [".?#", ".??"]),
        ({"mode": "raw", "occupied_thresh": 0.9, "negate": 1}, ["??.", "??#"]),
        ({"free_thresh": 0.9, "occupied_thresh": 0.05}, [".##", ".##"]),
    ],
)
def test_values_by_negate_thresholds_and_mode(saved, fields, rows):
    plan = saved(**fields)
    assert signs(plan) == rows
    assert (plan.resolution, plan.origin, plan.name) == (0.1, (-1.0, 2.0, 0.0), "m")


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


def published(pixel, mode, negate, occupied, free):
    """Return what map_server publishes for (red, green, blue, opacity), by its documentation.

    Opacity is a channel of trinary images; what is not opaque is unknown in scale images; raw
    images have no thresholds and no negate.
    """
    colours = pixel[:3] if mode != "trinary" else pixel
    shade = sum(257 * one for one in colours) / len(colours) / 65535
    if mode == "raw":
        percents = math.floor(255 * shade + 0.5)
        return percents if percents <= 100 else -1
    probability = shade if negate else 1.0 - shade
    if mode == "scale" and pixel[3] < 255:
        return -1
    if probability > occupied:
        return 100
    if probability < free:
        return 0
    if mode == "trinary":
        return -1
    if occupied == free:
        return 50
    return round((probability - free) / (occupied - free) * 100)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [0, 1, 7, "yes", "False", True, "n"])
def test_pixels_are_those_of_map_server(saved, mode, negate):
    greys = [
        (g, g, g, a)
        for g in (0, 51, 89, 102, 128, 204, 205, 254, 255)
        for a in (0, 128, 255)
    ]
    pixels = [*greys, (255, 0, 0, 255), (10, 200, 255, 255), (3, 3, 4, 255)]
    image = Image.fromarray(np.array([pixels], dtype=np.uint8))
    truth = negate in (1, 7, "yes", True)
    for occupied in (0.0, 0.2, 0.65, 1.0):
        for free in (0.0, 0.196, 0.2, 0.25, 1.0):
            said = {"negate": negate, "occupied_thresh": occupied, "free_thresh": free}
            values = [published(p, mode, truth, occupied, free) for p in pixels]
            if 0 not in values:
                if mode != "raw":
                    with pytest.raises(MapError, match="no pixel is free"):
                        saved(image, name="m.png", mode=mode, **said)
                continue
            plan = saved(image, name="m.png", mode=mode, **said)
            for value, is_free, is_occupied in zip(
                values, plan.free[0], plan.occupied[0], strict=True
            ):
                assert is_free == (value == 0) or (mode == "raw" and 0 < value < 100)
                assert is_occupied == (value == 100) or (
                    mode == "raw" and 0 < value < 100
                )


GREY = np.array([[[205, 205, 205, 255], [0, 0, 0, 255]]], dtype=np.uint8)


@pytest.mark.parametrize(
    ("pixels", "fields", "remedy"),
    [
        (GREY[..., 0], {"free_thresh": 0.25}, "set free_thresh to 0.196 in the YAML"),
        (GREY, {"free_thresh": 0.196}, "save the image without opacity, which counts"),
        (
            GREY,
            {"free_thresh": 0.25},
            "set free_thresh to 0.196 in the YAML file, and save the image without",
        ),
        (
            GREY[..., 0],
            {"free_thresh": 0.196, "mode": "scale"},
            "set free_thresh to 0.19 in the YAML",
        ),
    ],
)
def test_what_makes_grey_205_unknown_is_what_the_file_has_not_yet(
    saved, pixels, fields, remedy
):
    [remark] = saved(pixels, name="m.png", **fields).remarks
    assert f"where they are unknown, {remedy}" in remark


CLEAR_AND_BLACK = np.array([[[255, 255, 255, 0], [0, 0, 0, 255]]], dtype=np.uint8)


@pytest.mark.parametrize(
    ("pixels", "fields", "words"),
    [
        (CLEAR_AND_BLACK, {}, "50 % of the pixels are transparent, and count as"),
        (VALUES[:, 1:], {"free_thresh": 0}, "brighter than a share of 1 (1 - free"),
        (VALUES[:1, :2], {"negate": 1}, "darker than a share of 0.804"),
    ],
)
def test_where_no_pixel_is_free_the_cause_is_named(saved, pixels, fields, words):
    with pytest.raises(MapError) as refused:
        saved(pixels, name="m.png", **fields)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"resolution": -0.05},
            "setting resolution: value is -0.05, allowed: a number from 0.001",
        ),
        ({"resolution": float("nan")}, "setting resolution: value is nan"),
        ({"resolution": "left out"}, "field 'resolution' is missing"),
        ({"image": "left out"}, "field 'image' is missing"),
        ({"image": ["m.pgm"]}, "setting image: value is"),
        ({"image": "n.pgm"}, "n.pgm: no such image"),
        (
            {"image": "maps/m.pgm"},
            "m.pgm lies beside the YAML file: write 'image: m.pgm'",
        ),
        ({"image": "M.PGM"}, "m.pgm lies beside the YAML file: write 'image: m.pgm'"),
        ({"image": "m.yaml"}, "cannot be read as an image (its format is unknown)"),
        ({"image": "a\0b"}, "cannot be read as an image"),
        ({"origin": [0]}, "field 'origin' is [0]"),
        ({"origin": [0, float("inf"), 0]}, "field 'origin' is"),
        ({"negate": 0.5}, "setting negate: value is 0.5, allowed: 0, 1, true or"),
        ({"negate": "oui"}, "setting negate: value is 'oui', allowed"),
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
        (
            "image: [[[[[[[[[[[[[[1]]]]]]]]]]]]]]\nresolution: 1",
            "setting image: value is [[[[...]]]]",
        ),
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
