"""The server: who may talk to it, what it withstands, what survives it."""

import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from morphlet import FileError, InputError, RoiEditor, read, write
from morphlet.studio.access import Access
from morphlet.studio.hub import MOST_NOTES, Outbox
from morphlet.studio.messages import MESSAGES, MOST_TEXT
from morphlet.studio.recovery import Folder
from morphlet.studio.server import Running, serve
from studio.pages import Page, running, wait_for
from studio.shapes import egg, top

httpx = pytest.importorskip("httpx")
websockets = pytest.importorskip("websockets")

UP = {"translate": [0, 0, 0.4]}
SOAK = 5000


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A server that the tests of this file share; each leaves no drag and no job behind."""
    with running(tmp_path_factory.mktemp("served"), egg()) as server:
        yield server


def base(server: Running) -> str:
    return server.url.partition("/?")[0]


def token(server: Running) -> dict[str, str]:
    return {"token": server.access.token}


def refused_socket(server: Running, url: str | None = None, **headers: str) -> int:
    """The HTTP status that a socket is refused with."""
    with pytest.raises(websockets.exceptions.InvalidStatus, match="rejected") as caught:
        Page(url or server.url, additional_headers=headers or None)
    return caught.value.response.status_code


def test_a_socket_without_the_token_does_not_open(served):
    assert refused_socket(served, served.url + "x") == 403
    assert refused_socket(served, served.url.partition("?")[0] + "?") == 403


@pytest.mark.parametrize("origin", ["https://evil.example", "http://evil.example", "null", "http://127.0.0.1", "https://127.0.0.1:{port}"])
def test_a_socket_from_another_origin_does_not_open(served, origin):
    assert refused_socket(served, Origin=origin.format(port=served.port)) == 403


def test_a_socket_from_the_own_origin_opens(served):
    with Page(served.url, additional_headers={"Origin": base(served)}) as page:
        assert page.hello["protocol"] == 1


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", "127.0.0.1.evil.example:{port}"])
def test_another_host_is_refused(served, host):
    told = {"Host": host.format(port=served.port)}
    for path in ("/", "/save/session.json", "/static/x"):
        assert httpx.get(base(served) + path, params=token(served), headers=told).status_code == 403
    assert httpx.post(base(served) + "/upload", params=token(served), headers=told).status_code == 403


def test_http_needs_token_and_origin(served):
    for path in ("/", "/save/session.json"):
        assert httpx.get(base(served) + path).status_code == 403
        assert httpx.get(base(served) + path, params={"token": "wrong"}).status_code == 403
        assert httpx.get(base(served) + path, params=token(served), headers={"Origin": "https://evil.example"}).status_code == 403
    assert httpx.post(base(served) + "/upload?slot=source&name=x.ply", content=b"").status_code == 403
    assert httpx.get(base(served) + "/save/session.json", headers={"X-Morphlet-Token": served.access.token}).status_code == 200


def test_a_page_may_load_nothing_from_elsewhere(served):
    answer = httpx.get(base(served), params=token(served))
    rules = dict(part.strip().partition(" ")[::2] for part in answer.headers["Content-Security-Policy"].split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == "'self'"
    assert rules["frame-ancestors"] == "'none'"
    assert rules["connect-src"] == f"'self' ws://127.0.0.1:{served.port} ws://localhost:{served.port}"
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize(
    "path", ["/static/../app.py", "/static/%2e%2e/app.py", "/save/..%2f..%2fetc%2fpasswd", "/etc/passwd", "/save/lock"]
)
def test_no_file_of_the_machine_can_be_had(served, path):
    answer = httpx.get(base(served) + path, params=token(served))
    assert answer.status_code == 404


def send_too_much(page: Page) -> None:
    page.socket.send('{"type": "' + "x" * (MOST_TEXT + 1) + '"}')
    page.until_closed()


def test_an_oversize_message_closes_the_socket_and_the_others_go_on(served):
    with Page(served.url) as page, Page(served.url) as other:
        with pytest.raises(websockets.exceptions.ConnectionClosed, match=r"1009|no close frame"):  # the latter where the reset overtakes it
            send_too_much(page)
        assert other.ask("display", distortion=False)["type"] == "done"


@pytest.mark.parametrize("garbage", ["", "\x00\x01", "{", "[[[[", b"\xff\xfe\x00", b"", '{"type": "nonsense"}', '{"type": 3}'])
def test_garbage_is_answered_and_the_conversation_goes_on(served, garbage):
    with Page(served.url) as page:
        page.socket.send(garbage)
        assert page.until(lambda note: note["type"] == "error")["code"] in ("json", "type")
        assert page.ask("display", distortion=False)["type"] == "done"


def test_an_unknown_message_is_answered_with_its_number(served):
    with Page(served.url) as page:
        assert page.ask("shutdown")["code"] == "type"
        assert page.ask("hello", protocol=1)["code"] == "order"


@pytest.mark.parametrize(
    ("first", "code"), [('{"type": "undo"}', "order"), ('{"type": "hello", "protocol": 2}', "protocol"), ("x", "json")]
)
def test_a_page_that_does_not_greet_is_cut_off(served, first, code):
    with Page(served.url, greet=False) as page:
        page.socket.send(first)
        assert page.until(lambda note: note["type"] == "error")["code"] == code
        with pytest.raises(websockets.exceptions.ConnectionClosed, match="1008"):
            page.until_closed()


def test_no_more_pages_than_allowed(served):
    pages = [Page(served.url) for _ in range(8)]
    extra = Page(served.url, greet=False)
    with pytest.raises(websockets.exceptions.ConnectionClosed, match="1013"):
        extra.until_closed()
    for page in pages:
        page.close()


def reset(page: Page) -> None:
    """The mesh as in its file, its top painted."""
    assert page.ask("reset", what="all")["type"] == "done"
    assert page.ask("paint", role="handle", mode="set", vertices=top(egg()))["type"] == "done"


def until_shape(page: Page, server: Running) -> None:
    """Take what comes until the page shows the session's shape."""
    shape = server.studio.session.desk.edit.shape.astype(np.float32)
    while not np.array_equal(page.positions.get(0), shape):
        page.take()


def test_a_drag_through_the_socket_ends_at_the_librarys_answer(served):
    mesh = egg()
    with Page(served.url) as page:
        reset(page)
        page.ask("drag.begin")
        for seq in range(1, 6):
            page.send("drag.move", seq=seq, transform={"translate": [0, 0, 0.05 * seq]})
            page.until_frame(3, seq=seq)
        assert page.ask("drag.end", seq=6, transform=UP)["type"] == "done"
        page.until_frame(3, seq=6)
        session = served.studio.session
        roi = session.desk.edit.region(mesh)
        expected = RoiEditor.prepare(roi).solve(mesh.vertices[roi.handle] + [0, 0, 0.4], np.zeros((1, 3))).vertices
        assert np.abs(page.positions[0] - expected).max() < 1e-6
        answer = httpx.get(base(served) + "/save/mesh", params=token(served) | {"ending": ".ply"})
        assert answer.headers["Content-Disposition"] == 'attachment; filename="mesh-0-edited.ply"'


def test_overtaken_previews_are_answered_and_the_last_word_counts(served):
    with Page(served.url) as page:
        reset(page)
        numbers = [page.send("roi", radius=0.3 + 0.01 * k, live=True) for k in range(30)]
        numbers.append(page.send("roi", radius=0.9))
        answered = set()
        while answered != set(numbers):
            note = page.until(lambda note: note["type"] == "done")
            answered.add(note["id"])
        page.until_state(lambda state: state["edit"]["radius"] == 0.9)
        assert page.ask("undo")["type"] == "done"
        page.until_state(lambda state: state["edit"]["radius"] not in (0.9, 0.59))


def test_two_pages_see_the_same(served):
    with Page(served.url) as page, Page(served.url) as other:
        reset(page)
        page.ask("transform", transform=UP)
        other.until_state(lambda state: state["edit"]["transform"]["translate"][2] == 0.4)
        until_shape(other, served)
        with Page(served.url) as late:
            until_shape(late, served)
            assert late.state["edit"] == other.state["edit"] == page.state["edit"]


def test_what_one_page_drags_another_cannot(served):
    with Page(served.url) as page, Page(served.url) as other:
        reset(page)
        assert page.ask("drag.begin")["type"] == "done"
        assert other.ask("drag.begin")["code"] == "held"
        assert other.ask("undo")["code"] == "held"
        assert page.ask("drag.cancel")["type"] == "done"
        assert other.ask("drag.begin")["type"] == "done"
        assert other.ask("drag.cancel")["type"] == "done"


def test_a_page_that_goes_away_in_mid_drag_leaves_its_drag_where_it_was(served):
    with Page(served.url) as other:
        with Page(served.url) as page:
            reset(page)
            page.ask("drag.begin")
            page.send("drag.move", seq=1, transform=UP)
            page.until_frame(3, seq=1)
            page.socket.socket.close()  # no farewell
        state = other.until_state(lambda state: state["edit"]["transform"]["translate"] == [0, 0, 0.4])
        assert state["drag"] is None
        assert state["history"]["undo"] == "drag"
        assert other.ask("undo")["type"] == "done"


def test_a_slow_page_gets_the_newest_frame_and_holds_up_nobody(served):
    with Page(served.url) as page, Page(served.url, acknowledge=False) as slow:
        reset(page)
        page.ask("drag.begin")
        for seq in range(1, 21):
            page.send("drag.move", seq=seq, transform={"translate": [0, 0, 0.01 * seq]})
            page.until_frame(3, seq=seq)
        page.ask("drag.end", seq=30, transform=UP)
        slow.ask("display", distortion=False)
        assert len(slow.frames) == 2
        slow.acknowledge = True
        slow.socket.send(json.dumps({"type": "ack", "frame": slow.frames[-1][5]}))
        until_shape(slow, served)
        slow.ask("display", distortion=False)
        assert len(slow.frames) < 12


def test_files_are_opened_from_a_page(served, tmp_path):
    write(tmp_path / "small.obj", egg(1))
    data = (tmp_path / "small.obj").read_bytes()
    with Page(served.url) as page:
        answer = httpx.post(base(served) + "/upload", params=token(served) | {"slot": "target", "name": "../../small.obj"}, content=data)
        assert answer.json() == {"done": True}
        state = page.until_state(lambda state: state["meshes"]["target"] is not None)
        assert (state["meshes"]["target"]["name"], state["meshes"]["target"]["vertices"]) == ("small.obj", 42)
        csv = b"source,target,label\n5,7,nose\n"
        assert (
            httpx.post(base(served) + "/upload", params=token(served) | {"slot": "pairs", "name": "p.csv"}, content=csv).status_code == 200
        )
        assert httpx.get(base(served) + "/save/pairs.csv", params=token(served)).content == csv
        page.ask("close", slot="target")


@pytest.mark.parametrize(
    ("slot", "name", "data", "status"),
    [
        ("source", "x.ply", b"no mesh", 400),
        ("source", "x.ply", b"", 400),
        ("source", "x.obj", b"v 1 2 3\nf 1 2 9\n", 400),
        ("source", "x.gltf", b'{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"../../../../etc/passwd"}]}', 400),
        ("elsewhere", "x.ply", b"", 400),
        ("source", "x" * 200, b"", 400),
        ("session", "x.json", b"{}", 400),
        ("session", "x.json", b"\xff" * 100, 400),
        ("pairs", "x.csv", b"a,b\n", 400),
    ],
)
def test_what_is_no_file_of_its_kind_is_refused(served, slot, name, data, status):
    before = served.studio.session.desk.model
    answer = httpx.post(base(served) + "/upload", params=token(served) | {"slot": slot, "name": name}, content=data)
    assert answer.status_code == status
    assert set(answer.json()) == {"needed", "found", "advice"}
    assert "root:" not in answer.text
    assert served.studio.session.desk.model is before


def test_an_upload_that_is_too_large_is_refused(served, monkeypatch):
    from morphlet.studio import app

    monkeypatch.setattr(app, "MOST_UPLOAD", 1000)
    where = base(served) + "/upload", token(served) | {"slot": "source", "name": "x.ply"}
    assert httpx.post(where[0], params=where[1], content=b"x" * 1001).status_code == 413
    assert httpx.post(where[0], params=where[1], content=(b"x" * 100 for _ in range(100))).status_code == 413


def test_a_job_can_be_cancelled_and_holds_up_other_commands(tmp_path):
    with running(tmp_path, egg(), egg(2)) as server, Page(server.url) as page:
        number = page.send("correspond")
        page.until(lambda note: note["type"] == "progress")
        assert page.ask("undo")["code"] == "busy"
        assert httpx.get(base(server) + "/save/session.json", params=token(server)).status_code == 409
        page.send("cancel")
        page.until(lambda note: note.get("id") == number)
        assert [note["status"] for note in page.notes if note["type"] == "job" and note["kind"] == "correspond"] == ["started", "cancelled"]
        assert page.ask("display", distortion=False)["type"] == "done"


KILLED = """
import sys, time
from pathlib import Path
from morphlet.studio.server import Running
with Running([Path(sys.argv[1])], folder=Path(sys.argv[2])) as server:
    server.studio.worker.ask(lambda: None).result()
    print(server.url, flush=True)
    time.sleep(600)
"""


def test_no_edit_is_lost_when_the_server_is_killed(tmp_path):
    write(tmp_path / "egg.ply", egg())
    arguments = [sys.executable, "-c", KILLED, str(tmp_path / "egg.ply"), str(tmp_path / "sessions")]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        try:
            page = Page(process.stdout.readline().strip())
            reset(page)
            page.ask("transform", transform=UP)
            page.ask("drag.begin")
            time.sleep(1.1)  # a drag is written once a second
            page.ask("drag.move", seq=1, transform={"translate": [0.2, 0, 0.4]})
        finally:
            process.send_signal(signal.SIGKILL)
    with running(tmp_path) as server, Page(server.url) as page:
        page.until_state(lambda state: True)
        (left,) = page.state["recoverable"]
        assert (left["meshes"], left["edits"]) == (["egg.ply"], 1)
        assert page.ask("recover", name=left["name"])["type"] == "done"
        assert page.state["edit"]["transform"]["translate"] == [0.2, 0, 0.4]
        assert page.state["recoverable"] == []
        assert page.ask("recover", name=left["name"])["code"] == "field"


def test_a_page_comes_back_to_what_it_left(tmp_path):
    with running(tmp_path, egg()) as server:
        with Page(server.url) as page:
            reset(page)
            page.ask("transform", transform=UP)
            before = page.state
        with Page(server.url) as page:
            page.until_frame(4)
            assert page.state["edit"] == before["edit"]
            assert page.state["history"] == before["history"]


def message(draw: random.Random, n: int) -> str | bytes:
    """A random message: mostly right, sometimes wrong, sometimes garbage."""
    kind = draw.choice([kind for kind in MESSAGES if kind not in ("hello", "sample", "correspond", "morph", "close", "regions")])
    if draw.random() < 0.05:
        return draw.choice([b"\xff\x00", "", "{", "null", '{"type":[]}', "x" * 1000])
    some = [draw.randrange(-1 if draw.random() < 0.05 else 0, n) for _ in range(draw.randrange(6))]
    values = {
        "frame": draw.randrange(10**6), "slot": draw.choice(["source", "target", "morph"]), "bands": [],
        "name": draw.choice(["arap", "mls", "rotations", "direct", "?"]), "live": draw.random() < 0.5,
        "role": draw.choice(["handle", "free", "anchor"]), "mode": draw.choice(["set", "add", "erase"]), "vertices": some,
        "radius": draw.choice([None, 0.1, 0.5, 1.0, -1]), "metric": draw.choice(["geodesic", "edges", "euclidean"]),
        "index": draw.randrange(3),
        "plane": draw.choice([None, {"axis": "y"}, {"point": [0, 0, 0], "normal": [1, 1, 0]}]), "seq": draw.randrange(10**4),
        "transform": {"translate": [draw.uniform(-1, 1) for _ in range(3)], "rotate": draw.choice([[0, 0, 0, 1], [0, 0, 1, 0]])},
        "what": draw.choice(["transform", "all"]), "distortion": draw.random() < 0.5, "source": draw.randrange(n),
        "target": draw.randrange(n), "vertex": draw.randrange(n), "time": draw.random(),
    }  # fmt: skip
    told = {key: values[key] for key in MESSAGES[kind] if key in values and draw.random() < 0.97}
    return json.dumps({"type": kind, "id": draw.randrange(1000)} | told)


def resident() -> int:
    """Bytes of this process in memory; none where the system does not say."""
    if not os.path.exists("/proc/self/statm"):
        return 0
    with open("/proc/self/statm") as stream:
        return int(stream.read().split()[1]) * resource.getpagesize()


def test_five_thousand_random_messages_crash_and_leak_nothing(tmp_path):
    draw = random.Random(0)
    with running(tmp_path, egg(2), egg(2)) as server:
        session = server.studio.session
        held, seen, dragged = [], set(), False
        for part in range(4):
            with Page(server.url) as page:
                for k in range(SOAK // 4):
                    page.socket.send(message(draw, 162))
                    if k % 50 == 49:
                        page.ask("display", distortion=False)
                seen |= {note.get("code") for note in page.notes}
                dragged |= any(head[2] == 3 and head[10] > 0 for head in page.frames)
            assert server.studio.worker.ask(lambda: session.state()["meshes"]["source"]["vertices"]).result(60) == 162, part
            held.append(resident())
        assert "internal" not in seen
        assert dragged
        assert seen >= {"json", "type", "field", "input", "order"} - {"type"}
        assert held[-1] - held[1] < 64 * 2**20
        wait_for(lambda: server.studio.hub.boxes == {})
        with Page(server.url) as page:
            assert page.ask("reset", what="all")["type"] == "done"


def test_at_most_two_meshes(tmp_path):
    with pytest.raises(InputError, match="at most two meshes"):
        Running([tmp_path] * 3)


def test_an_address_that_is_taken_is_an_error(served, tmp_path):
    with pytest.raises(FileError, match=f"a free address 127.0.0.1:{served.port}"):
        Running(port=served.port, folder=tmp_path)


def test_small_messages_wait_for_no_others(served):
    """Of sockets that are not named TCP, asyncio leaves Nagle's algorithm on: 40 ms now and then."""
    assert served.listening.proto == socket.IPPROTO_TCP


def test_another_address_is_warned_of(tmp_path, monkeypatch):
    said = []
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(Running, "run", lambda self, ready: ready())
    urls = []
    serve(host="0.0.0.0", say=said.append, ready=urls.append)
    assert "other machines" in said[0]
    assert said[1].startswith("morphlet studio: http://127.0.0.1:")
    said.clear()
    serve(say=said.append)
    assert len(said) == 1


def test_names_are_allowed_only_with_the_port():
    rules = Access.of("t", "0.0.0.0", 8080, ("studio.lan",))
    assert rules.own_host("Studio.LAN:8080")
    assert not rules.own_host("studio.lan")
    assert not rules.own_host(None)
    assert rules.own_origin("http://studio.lan:8080")
    assert not rules.own_origin("https://studio.lan:8080")
    assert not rules.own_host("0.0.0.0:8080")
    assert Access.of("t", "127.0.0.1", 80).own_host("127.0.0.1")


def test_a_page_that_takes_no_notes_is_cut_off():
    box = Outbox(1)
    for _ in range(MOST_NOTES):
        box.add_note("x", None)
    assert not box.cut.is_set()
    for _ in range(10):
        box.add_note("x", None)
    assert box.cut.is_set()
    assert len(box.notes) == MOST_NOTES


def test_the_folder_is_for_its_owner_alone(tmp_path):
    folder = Folder.create(tmp_path / "sessions")
    assert os.stat(folder.path).st_mode & 0o077 == 0
    folder.close(keep=False)
    assert not folder.path.exists()


def test_saved_meshes_can_be_read(served, tmp_path):
    for ending in (".ply", ".obj", ".off", ".stl", ".glb"):
        (tmp_path / f"out{ending}").write_bytes(
            httpx.get(base(served) + "/save/mesh", params=token(served) | {"slot": "source", "ending": ending}).content
        )
        assert read(tmp_path / f"out{ending}").n_faces == egg().n_faces
    assert httpx.get(base(served) + "/save/mesh", params=token(served) | {"ending": ".exe"}).status_code == 400
    assert httpx.get(base(served) + "/save/morph.glb", params=token(served)).status_code == 409
