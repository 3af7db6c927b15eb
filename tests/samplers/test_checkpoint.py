"""What is kept comes back, and what was damaged is not used."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from imapper_prob.samplers import checkpoint
from imapper_prob.samplers.checkpoint import (
    Checkpointer,
    CheckpointError,
    Snapshot,
    load,
    pack,
    pack_rng,
    save,
    unpack,
    unpack_rng,
)

SNAPSHOT = Snapshot(
    {"empty": np.empty((0, 3)), "flags": np.array([True, False]), "x": np.arange(6.0)[None]},
    {"steps": 12, "text": "ä", "big": 2**100, "tenth": 0.1, "list": [1, None]},
)


def assert_same(one: Snapshot, other: Snapshot) -> None:
    assert one.values == other.values
    assert set(one.arrays) == set(other.arrays)
    for name, array in one.arrays.items():
        np.testing.assert_array_equal(array, other.arrays[name], strict=True)


def test_a_snapshot_comes_back(tmp_path):
    path = tmp_path / "chain-0.npz"
    assert load(path, identity="a") is None
    save(path, SNAPSHOT, identity="a")
    assert_same(load(path, identity="a"), SNAPSHOT)
    assert [file.name for file in tmp_path.iterdir()] == ["chain-0.npz"]


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    path = tmp_path / "chain-0.npz"
    save(path, SNAPSHOT, identity="a")
    with pytest.raises(CheckpointError, match=r"chain-0\.npz belongs to .* other settings"):
        load(path, identity="b")


def test_another_file_is_refused(tmp_path):
    path = tmp_path / "chain-0.npz"
    np.savez(path, x=np.arange(3))
    with pytest.raises(CheckpointError, match=r"damaged or no checkpoint \(KeyError\): delete it"):
        load(path, identity="a")
    path.write_text("nothing of the kind")
    with pytest.raises(CheckpointError, match="damaged or no checkpoint"):
        load(path, identity="a")


def test_objects_are_neither_written_nor_read(tmp_path):
    path = tmp_path / "chain-0.npz"
    save(path, SNAPSHOT, identity="a")
    before = path.read_bytes()
    with pytest.raises(ValueError, match="Object arrays cannot be saved"):
        save(path, Snapshot({"x": np.array([{}])}, {}), identity="a")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    np.savez(path, x=np.array([{}]), allow_pickle=True)
    with pytest.raises(CheckpointError, match="ValueError"):
        load(path, identity="a")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("checkpoint") / "chain-0.npz"
    save(path, SNAPSHOT, identity="a")
    return path


@given(data=st.data())
def test_a_changed_byte_is_found_or_harmless(written, data):
    content = bytearray(written.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    changed = written.with_name("changed.npz")
    changed.write_bytes(content)
    try:
        found = load(changed, identity="a")
    except CheckpointError:
        return
    assert_same(found, SNAPSHOT)


@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_that_ends_early_is_found(written, share):
    content = written.read_bytes()
    cut = written.with_name("cut.npz")
    cut.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CheckpointError, match=r"cut\.npz is damaged"):
        load(cut, identity="a")


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_failed_write_leaves_the_last_checkpoint(tmp_path, monkeypatch, call):
    path = tmp_path / "chain-0.npz"
    save(path, SNAPSHOT, identity="a")

    def full(*arguments: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, call, full)
    with pytest.raises(OSError, match="no space left"):
        save(path, Snapshot({}, {}), identity="a")
    assert_same(load(path, identity="a"), SNAPSHOT)
    assert list(tmp_path.iterdir()) == [path]


@given(seed=st.integers(0, 2**128), draws=st.integers(0, 50), children=st.integers(0, 3))
def test_a_generator_goes_on_where_it_stood(seed, draws, children):
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(4,)))
    rng.spawn(children)
    rng.standard_normal(draws)
    rng.integers(10, size=draws, dtype=np.uint32)  # leaves half a word behind
    again = unpack_rng(pack_rng(rng))
    np.testing.assert_array_equal(rng.random(20), again.random(20))
    np.testing.assert_array_equal(
        rng.integers(10, size=9, dtype=np.uint32), again.integers(10, size=9, dtype=np.uint32)
    )
    np.testing.assert_array_equal(rng.spawn(1)[0].random(5), again.spawn(1)[0].random(5))


def test_other_generators_are_refused():
    with pytest.raises(TypeError, match="only generators of default_rng"):
        pack_rng(np.random.Generator(np.random.MT19937(3)))


fields = st.lists(
    st.fixed_dictionaries(
        {
            "items": st.integers(0, 4).flatmap(lambda k: hnp.arrays(np.int64, (k, 2))),
            "camera": hnp.arrays(float, 4),
        }
    ),
    max_size=5,
)


@given(fields)
def test_states_of_any_size_are_packed_and_unpacked(items):
    arrays = pack("draws", items) | pack("other", items[:1])
    found = unpack("draws", arrays)
    assert len(found) == len(items)
    for one, other in zip(items, found, strict=True):
        for name in ("items", "camera"):
            np.testing.assert_array_equal(one[name], other[name], strict=True)


def test_a_checkpointer_writes_when_it_is_due(tmp_path, monkeypatch):
    clock = iter((100.0, 101.0, 104.9, 105.0, 105.1, 109.9, 112.0, 112.1))
    monkeypatch.setattr(checkpoint.time, "monotonic", clock.__next__)
    checkpointer = Checkpointer(tmp_path / "chain-0.npz", identity="a", every_seconds=5.0)
    taken = []

    def snapshot() -> Snapshot:
        taken.append(len(taken))
        return SNAPSHOT

    # Due at 105 and, written by 105.1, again at 110.1; each write looks at the clock once more.
    counts = [checkpointer.offer(snapshot) or len(taken) for _ in range(5)]
    assert counts == [0, 0, 1, 1, 2]
    assert_same(checkpointer.load(), SNAPSHOT)
