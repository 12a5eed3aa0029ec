"""Which LLVM is found, by file names alone, and what is said where there is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from phrt_mitsuba import llvm


def place(folder: Path, *names: str) -> tuple[str, ...]:
    """Empty files of these names below `folder`; the pattern that finds them."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return (f"{folder}/**/libLLVM*",)


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM.so.19.1", 19),
        ("libLLVM-17.so.1", 17),
        ("libLLVM-14.0.6.so", 14),
        ("libLLVM.so.20.1", 20),
        ("llvm-18/lib/libLLVM.so", 18),
        ("Cellar/llvm/21.1.8/lib/libLLVM.dylib", 21),
        ("opt/llvm@17/lib/libLLVM.dylib", 17),
        ("lib/libLLVM.so", None),
    ],
)
def test_the_version_is_read_from_the_name_or_the_folder(tmp_path: Path, name: str, version: int | None) -> None:
    place(tmp_path, name)
    assert llvm.version_of(tmp_path / name) == version


def test_a_link_has_the_version_of_what_it_names(tmp_path: Path) -> None:
    place(tmp_path, "libLLVM.so.19.1")
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.19.1")
    assert llvm.version_of(tmp_path / "libLLVM.so") == 19


def test_the_newest_comes_first_and_old_ones_are_left_out(tmp_path: Path) -> None:
    places = place(tmp_path, "libLLVM-15.so.1", "libLLVM.so.19.1", "libLLVM-17.so.1", "libLLVM.so.20.1", "libLLVM-9.so")
    assert [Path(path).name for path in llvm.usable({}, places)] == [
        "libLLVM.so.20.1",
        "libLLVM.so.19.1",
        "libLLVM-17.so.1",
    ]
    assert llvm.missing_reason({}, places) is None


def test_one_file_of_two_names_is_one_library(tmp_path: Path) -> None:
    places = place(tmp_path, "libLLVM.so.19.1")
    (tmp_path / "libLLVM-19.so").symlink_to("libLLVM.so.19.1")
    assert [library.version for library in llvm.installed(places)] == [19]


def test_without_a_library_the_package_to_install_is_named(tmp_path: Path) -> None:
    reason = llvm.missing_reason({}, place(tmp_path))
    assert reason is not None
    assert "version 17 or newer, and none was found: apt-get install libllvm19" in reason
    assert "DRJIT_LIBLLVM_PATH=" in reason


def test_old_libraries_are_named_as_what_they_are(tmp_path: Path) -> None:
    reason = llvm.missing_reason({}, place(tmp_path, "libLLVM-14.so.1", "libLLVM-15.so.1"))
    assert reason is not None
    assert f"only {tmp_path}/libLLVM-15.so.1 (LLVM 15), {tmp_path}/libLLVM-14.so.1 (LLVM 14)" in reason
    assert "which cannot compile what Dr.Jit writes: apt-get install libllvm19" in reason


def test_what_the_user_names_is_the_only_one_tried(tmp_path: Path) -> None:
    places = place(tmp_path, "libLLVM.so.19.1", "mine/libLLVM-15.so")
    mine = str(tmp_path / "mine" / "libLLVM-15.so")
    assert llvm.usable({llvm.VARIABLE: mine}, places) == [mine]
    assert llvm.missing_reason({llvm.VARIABLE: mine}, places) is None


def test_a_name_for_the_linker_is_left_to_the_linker() -> None:
    assert llvm.missing_reason({llvm.VARIABLE: "libLLVM.so"}, ()) is None


def test_a_file_that_is_not_there_is_named() -> None:
    assert llvm.missing_reason({llvm.VARIABLE: "/nowhere/libLLVM.so"}, ()) == (
        "DRJIT_LIBLLVM_PATH names '/nowhere/libLLVM.so', and there is no such file"
    )
