# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag that other tools have rewritten is as good as ours: pymcap-cli, rosbags, mcap."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from recordings import chunks_in

from sparse_coord_ros.log.bags.reader import bag_files
from sparse_coord_ros.log.runlog import read_run, verify

PROGRAMS = Path(sys.executable).parent


def run(program, *words):
    """Run a program of the environment; its error fails the test."""
    done = subprocess.run(
        [PROGRAMS / program, *words],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def pymcap(*words):
    run("pymcap-cli", "--quiet", *words)


def to_file(*words):
    """Return a way: pymcap-cli writes another file."""

    def rewrite(source, directory):
        pymcap(words[0], source, *words[1:], "-o", directory / "bag_0.mcap")

    return rewrite


def added(*words):
    """Return a way: pymcap-cli adds a record to the file."""

    def rewrite(source, directory):
        shutil.copy(source, directory / "bag_0.mcap")
        (directory / "note.txt").write_text("hello")
        where = [word.replace("DIR", str(directory)) for word in words]
        pymcap("add", where[0], directory / "bag_0.mcap", *where[1:])

    return rewrite


def by_mcap(**options):
    """Return a way: mcap's writer writes the messages again."""

    def rewrite(source, directory):
        with (
            source.open("rb") as file,
            (directory / "bag_0.mcap").open("wb") as new_file,
        ):
            reader = make_reader(file)
            writer = Writer(new_file, **options)
            writer.start(profile="ros2", library="any")
            channels = {}
            for schema, channel, message in reader.iter_messages():
                if channel.id not in channels:
                    kind = writer.register_schema(
                        schema.name, schema.encoding, schema.data
                    )
                    channels[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, kind, channel.metadata
                    )
                times = message.log_time, message.data, message.publish_time
                writer.add_message(channels[channel.id], *times)
            writer.finish()

    return rewrite


def cut_and_recovered(source, directory):
    """Cut the end off, without which no message is lost."""
    offset, length = chunks_in(source)[-1]
    (directory / "cut").write_bytes(source.read_bytes()[: offset + length])
    pymcap("recover", directory / "cut", "-o", directory / "bag_0.mcap")


def halves(source, directory):
    at = f"{read_run(source).step[-1] // 2 * 100_000_000}ns"
    pymcap("filter", source, "--end", at, "-o", directory / "bag_0.mcap")
    pymcap("filter", source, "--start", at, "-o", directory / "bag_1.mcap")


def halves_merged(source, directory):
    (directory / "halves").mkdir()
    halves(source, directory / "halves")
    parts = sorted((directory / "halves").iterdir())
    pymcap("merge", *parts, "-o", directory / "bag_0.mcap")
    shutil.rmtree(directory / "halves")


def merged_with_itself(source, directory):
    shutil.copy(source, directory / "other")
    pymcap("merge", source, directory / "other", "-o", directory / "bag_0.mcap")


def to_mcap(source, directory):
    storage = "--dst-storage", "mcap"
    run("rosbags-convert", "--src", source, "--dst", directory, *storage)


def converted(source, directory):
    to_mcap(source.parent, directory / "bag")


def converted_to_sqlite_and_back(source, directory):
    whole = directory / "sqlite"
    run(
        *("rosbags-convert", "--src", source.parent, "--dst", whole),
        *("--dst-storage", "sqlite3"),
    )
    to_mcap(whole, directory / "bag")


WAYS = {
    "a metadata record": added("metadata", "--name", "note", "--key", "operator=me"),
    "an attachment": added("attachment", "--file", "DIR/note.txt"),
    "sorted": to_file("sort"),
    "unchunked": to_file("sort", "--no-chunks", "--no-crc"),
    "rechunked": to_file("rechunk", "--strategy", "all"),
    "recovered": to_file("recover", "--always-decode-chunk"),
    "cut and recovered": cut_and_recovered,
    "filtered": to_file("filter", "--exclude-topic", "/(world_simulator/.*|rosout)"),
    "lz4": to_file("compress", "--compression", "lz4"),
    "uncompressed": to_file("decompress"),
    "two files": halves,
    "two files merged": halves_merged,
    "merged with itself": merged_with_itself,
    "rosbags": converted,
    "rosbags, sqlite3": converted_to_sqlite_and_back,
    "without checksums": by_mcap(enable_crcs=False),
    "without chunks": by_mcap(use_chunking=False, enable_data_crcs=True),
    "without indexes": by_mcap(compression=CompressionType.NONE, use_statistics=False),
}


@pytest.fixture(scope="module")
def bag(record):
    """Record a run in which robots ask, and of which no topic is missing."""
    return record(settings={"steps": 300, "perception": "probability:0.6"}).bag


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_a_bag_that_a_tool_has_rewritten_is_identical(bag, tmp_path, way):
    [source] = bag_files(bag)
    directory = tmp_path / "new"
    directory.mkdir()
    WAYS[way](source, directory)
    found = verify(directory)
    assert found.same, found.first
    assert found.steps == 300
