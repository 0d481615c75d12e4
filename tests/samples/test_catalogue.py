"""The catalogue without a network: mirrors, caches, archives and what goes wrong."""

import hashlib
import io
import os
import tarfile
import zipfile

import pooch
import pytest

from morphlet import FileError, InputError
from morphlet.samples import catalogue
from morphlet.samples.catalogue import CATALOGUE, Entry, fetch

CONTENT = b"v 0 0 0\n"
SHA = hashlib.sha256(CONTENT).hexdigest()


def served(monkeypatch, content, url="https://example.org/toy.obj", member="", sha256=SHA):
    """Let the catalogue hold 'toy.obj' and the network answer with this content; the list of addresses asked."""
    asked = []

    class Downloader:
        def __init__(self, progressbar):
            pass

        def __call__(self, url, output_file, pooch):
            asked.append(url)
            if isinstance(content, Exception):
                raise content
            output_file.write(content)

    monkeypatch.setattr(pooch, "HTTPDownloader", Downloader)
    monkeypatch.setitem(CATALOGUE, "toy.obj", Entry(url, sha256, "CC0", member))
    return asked


def test_every_entry_is_complete():
    assert len(CATALOGUE) > 40
    for name, entry in CATALOGUE.items():
        assert entry.url.startswith("https://raw.githubusercontent.com/")
        assert len(entry.sha256) == 64
        assert int(entry.sha256, 16) >= 0
        assert entry.licence
        assert bool(entry.member) == entry.url.endswith((".zip", ".tgz")), name


def test_mirror_finds_files_in_subfolders(tmp_path, monkeypatch):
    asked = served(monkeypatch, CONTENT)
    (tmp_path / "deep" / "er").mkdir(parents=True)
    path = tmp_path / "deep" / "er" / "toy.obj"
    path.write_bytes(CONTENT)
    assert fetch("toy.obj", mirror=tmp_path) == path
    assert asked == []


def test_mirror_of_two_files_gives_the_right_one(tmp_path, monkeypatch):
    served(monkeypatch, CONTENT)
    for folder, content in (("a", b"other"), ("b", CONTENT)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "toy.obj").write_bytes(content)
    assert fetch("toy.obj", mirror=tmp_path) == tmp_path / "b" / "toy.obj"


def test_mirror_with_other_content_is_refused(tmp_path):
    (tmp_path / "cat.obj").write_bytes(CONTENT)
    with pytest.raises(FileError, match=f"needed SHA-256 {CATALOGUE['cat.obj'].sha256}.*found {SHA}"):
        fetch("cat.obj", mirror=tmp_path)


def test_mirror_without_the_file_names_the_address(tmp_path):
    with pytest.raises(FileError, match=r"no such file.*igea\.ply"):
        fetch("igea.ply", mirror=tmp_path)


def test_unknown_name_lists_close_ones(tmp_path):
    with pytest.raises(InputError, match=r"found .horse.off.; did you mean horse.*.off"):
        fetch("horse.off", mirror=tmp_path)


def test_download_goes_to_the_cache_once(tmp_path, monkeypatch):
    asked = served(monkeypatch, CONTENT)
    path = fetch("toy.obj", cache=tmp_path / "new")
    assert path.read_bytes() == CONTENT
    assert fetch("toy.obj", cache=tmp_path / "new") == path
    assert asked == ["https://example.org/toy.obj"]


def test_spoilt_cache_is_noticed(tmp_path, monkeypatch):
    served(monkeypatch, CONTENT)
    fetch("toy.obj", cache=tmp_path).write_bytes(b"spoilt")
    with pytest.raises(FileError, match="SHA-256"):
        fetch("toy.obj", cache=tmp_path)


def test_wrong_download_is_refused_and_not_kept(tmp_path, monkeypatch):
    served(monkeypatch, b"<html>not found</html>")
    with pytest.raises(FileError, match=r"SHA-256 .* for https://example\.org/toy\.obj"):
        fetch("toy.obj", cache=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_no_network_names_address_and_mirror(tmp_path, monkeypatch):
    served(monkeypatch, OSError("name resolution failed"))
    with pytest.raises(FileError, match=r"https://example\.org/toy\.obj.*name resolution failed.*mirror="):
        fetch("toy.obj", cache=tmp_path)


def zipped(names):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in names:
            archive.writestr(name, CONTENT)
    return stream.getvalue()


def tarred(names):
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        for name in names:
            info = tarfile.TarInfo(name)
            info.size = len(CONTENT)
            archive.addfile(info, io.BytesIO(CONTENT))
    return stream.getvalue()


@pytest.mark.parametrize(("pack", "url"), [(zipped, "https://example.org/a.zip"), (tarred, "https://example.org/a.tgz")])
def test_member_of_an_archive(tmp_path, monkeypatch, pack, url):
    served(monkeypatch, pack(["in/._toy.obj", "in/toy.obj", "in/other.obj"]), url, "*toy.obj")
    assert fetch("toy.obj", cache=tmp_path).read_bytes() == CONTENT


def test_archive_without_the_member(tmp_path, monkeypatch):
    served(monkeypatch, zipped(["other.obj"]), "https://example.org/a.zip", "*toy.obj")
    with pytest.raises(FileError, match=r"one file like \*toy\.obj .*found 0"):
        fetch("toy.obj", cache=tmp_path)


@pytest.mark.parametrize("url", ["https://example.org/a.zip", "https://example.org/a.tgz"])
def test_broken_archive(tmp_path, monkeypatch, url):
    served(monkeypatch, b"this is no archive", url, "*toy.obj")
    with pytest.raises(FileError, match="needed an archive at https"):
        fetch("toy.obj", cache=tmp_path)


def test_default_cache_is_the_users(monkeypatch, tmp_path):
    monkeypatch.setattr(pooch, "os_cache", lambda name: tmp_path / name)
    assert catalogue._cache(None) == tmp_path / "morphlet"


@pytest.mark.skipif("MORPHLET_DATA" not in os.environ, reason="set MORPHLET_DATA to the folder of public test meshes")
def test_catalogue_fits_the_real_files():
    for name in CATALOGUE:
        assert fetch(name, mirror=os.environ["MORPHLET_DATA"]).name == name
