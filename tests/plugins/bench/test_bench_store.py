"""The folder of a benchmark: nothing in it is ever seen half."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from phrt.errors import OptionError
from phrt_plugins.bench import store as store_module
from phrt_plugins.bench.plan import Block
from phrt_plugins.bench.store import Store, whole_folder

BLOCK = Block(2, 20, 30)


def test_a_folder_is_there_only_when_it_is_whole(tmp_path: Path) -> None:
    target = tmp_path / "cells" / "one" / "block-000"
    with whole_folder(target) as part:
        (part / "pictures").mkdir()
        (part / "pictures" / "a.png").write_bytes(b"a")
        assert not target.exists()
        assert part.parent == target.parent
        assert part.name.startswith("block-000.")
        assert part.name.endswith(".part")
    assert (target / "pictures" / "a.png").read_bytes() == b"a"
    assert [path.name for path in target.parent.iterdir()] == ["block-000"]


def test_what_goes_wrong_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with whole_folder(tmp_path / "block") as part:
            (part / "half").write_text("ha")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_renamed_that_is_not_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[str] = []
    fsync, rename = os.fsync, os.rename

    def note(descriptor: int) -> None:
        synced.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).name)
        fsync(descriptor)

    def renamed(source: Path, target: Path) -> None:
        assert set(synced) == {"a", "b", "inner", source.name}
        rename(source, target)

    monkeypatch.setattr(store_module.os, "fsync", note)
    monkeypatch.setattr(store_module.os, "rename", renamed)
    with whole_folder(tmp_path / "block") as part:
        (part / "inner").mkdir()
        (part / "a").write_text("a")
        (part / "inner" / "b").write_text("b")
    assert synced[-1] == tmp_path.name


def test_a_disk_that_refuses_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store_module.os, "fsync", full)
    with pytest.raises(OSError, match="No space left"), whole_folder(tmp_path / "block") as part:
        (part / "a").write_text("a")
    assert list(tmp_path.iterdir()) == []


def test_who_shares_a_folder_and_is_late_gives_way(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "key") as mine:
        (mine / "who").write_text("me")
        with whole_folder(tmp_path / "key") as other:
            (other / "who").write_text("other")
    assert (tmp_path / "key" / "who").read_text() == "other"
    assert [path.name for path in tmp_path.iterdir()] == ["key"]


def test_a_folder_belongs_to_the_run_that_took_it_last(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert not store.belongs_to("one")
    store.take_over("one")
    assert store.belongs_to("one")
    store.take_over("two")
    assert not store.belongs_to("one")


def test_the_first_reason_of_a_failure_stays(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.failure("one") is None
    store.fail("one", BLOCK, "disk", "full")
    store.fail("one", None, "scene", "gone")
    assert store.failure("one") == {"block": 2, "kind": "disk", "reason": "full"}
    store.forgive("one")
    store.forgive("one")
    assert store.failure("one") is None


def test_a_damaged_failure_is_still_a_failure(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.fail("one", BLOCK, "disk", "full")
    (tmp_path / "cells" / "one" / "failed.json").write_text('{"bl')
    assert store.failure("one") == {"block": None, "kind": "unknown", "reason": "unknown"}


def test_settings_are_written_once(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.begin_cell({"id": "one", "size": (64, 36)})
    path = tmp_path / "cells" / "one" / "cell.json"
    before = path.stat().st_ino
    store.begin_cell({"id": "one", "size": (64, 36)})
    assert path.stat().st_ino == before
    store.begin_cell({"id": "one", "size": (32, 18)})
    assert json.loads(path.read_text())["size"] == [32, 18]


def test_only_a_folder_of_this_version_is_resumed(tmp_path: Path) -> None:
    assert Store(tmp_path / "nowhere").about() is None
    for text in ("{", "[]", '{"phrt_bench": 9}'):
        (tmp_path / "bench.json").write_text(text)
        with pytest.raises(OptionError, match=r"cannot be resumed: its bench\.json is not one that this phrt writes"):
            Store(tmp_path).about()


def test_a_run_that_was_killed_at_once_leaves_an_empty_folder(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with store.locked():
        assert store.is_empty()
        (tmp_path / "config.yaml").write_text("name: x")
        (tmp_path / ".bench.0011.json").write_text("{")
        assert store.is_empty()
        (tmp_path / "mine.txt").write_text("x")
        assert not store.is_empty()


def test_what_was_half_written_is_swept_away(tmp_path: Path) -> None:
    kept = [
        "cells/one/block-000/a",
        "cells/one/cell.json",
        "oracle/s/block-000.parquet",
        ".lock",
        "config.yaml",
        ".mine",
    ]
    half = [
        "cells/one/block-001.part/a",
        "cells/one/.cell.0123456789ab.json",
        "oracle/s/.items-000.0123456789ab.parquet",
    ]
    for name in (*kept, *half):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    Store(tmp_path).sweep()
    left = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()]
    assert sorted(left) == sorted(kept)


def test_a_lock_ends_with_its_process(tmp_path: Path) -> None:
    code = (
        "import sys, os, signal; from phrt_plugins.bench.store import Store\n"
        "with Store(sys.argv[1]).locked():\n    print('held', flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (-9, "held\n")
    with (
        Store(tmp_path).locked(),
        pytest.raises(OptionError, match="is in use by another `phrt bench`"),
        Store(tmp_path).locked(),
    ):
        raise AssertionError("two have it")
