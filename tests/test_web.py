"""Who may see and command the robot through the page, and that nothing else gets through."""

import asyncio
import json
import ssl
import subprocess
import time
from contextlib import suppress
from dataclasses import replace
from shutil import which
from typing import Any

import aiohttp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd import app, clock, config
from followerd.bench.closed_loop import simulate
from followerd.config import WebSection
from followerd.errors import DeviceError, UsageError
from followerd.messages import Fault, Image, Mode, StopReason
from followerd.runtime.daemon import Daemon
from followerd.web.access import COOKIE, Access, Command
from followerd.web.hub import HEADER, Hub
from followerd.web.requests import parse
from followerd.web.server import encryption
from tests.page_fuzz import fuzz
from tests.web_page import Served, opened, served

GOOD = [
    {"do": "ack", "frame": 3},
    {"do": "arm"},
    {"do": "enrol", "region": [1, 2], "frame": 3},
    {"do": "enrol", "region": [1, 2, 30, 40], "frame": 3},
    {"do": "drive", "forward": 0.5, "left": -1},
    {"do": "record", "on": True},
    {"do": "choose", "tracker": "hpf/paper"},
]
BAD = [
    "",
    "{",
    "[]",
    "null",
    '{"do": "explode"}',
    '{"do": "arm", "more": 1}',
    '{"do": "drive", "forward": NaN, "left": 0}',
    '{"do": "drive", "forward": 1e9, "left": 0}',
    '{"do": "drive", "forward": true}',
    '{"do": "enrol", "region": [1], "frame": 3}',
    '{"do": "enrol", "region": [1, 2], "frame": "x"}',
    '{"do": "record", "on": "maybe"}',
]
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)


@pytest.mark.parametrize("message", GOOD, ids=lambda m: m["do"])
def test_a_request_is_understood(message: dict[str, Any]) -> None:
    assert parse(json.dumps(message)).do == message["do"]


@pytest.mark.parametrize("text", BAD)
def test_a_malformed_request_is_refused_with_a_reason(text: str) -> None:
    with pytest.raises(UsageError, match=r".+"):
        parse(text)


@given(json_values | st.fixed_dictionaries({"do": st.sampled_from(["drive", "enrol", "ack"])}))
def test_whatever_is_sent_is_a_request_or_refused(value: Any) -> None:
    with suppress(UsageError):
        assert parse(json.dumps(value)).do


def test_a_token_is_guessed_five_times_at_most() -> None:
    access = Access(WebSection(host="0.0.0.0"))
    assert len(access.token) >= 24
    assert access.login(access.token, 0.0)
    assert not any(access.login("guess", 0.1 * k) for k in range(5))
    assert access.login(access.token, 1.0) is None  # not even the right one, for a minute
    assert access.login(access.token, 70.0)


def test_one_commands_until_he_is_gone() -> None:
    command = Command(patience=3.0)
    assert command.take("a", 0.0)
    assert not command.take("b", 2.0)
    assert command.sign("a", 2.5)
    assert not command.take("b", 5.0)
    assert command.take("b", 6.0)
    assert not command.sign("a", 6.1)


async def newest(here: Served) -> Image:
    """The newest picture, once there is one."""
    while here.page.hub.image is None:
        await clock.sleep(0.02)
    return here.page.hub.image


def doing(here: Served) -> tuple[Mode, bool]:
    """The daemon's mode, and whether it stands."""
    assert here.daemon.decision is not None
    return here.daemon.decision.mode, here.daemon.decision.command.stops


NAMES = {"localhost:1": 200, "evil.example": 403, "192.168.1.7": 403, "[": 403}


async def test_only_names_of_this_computer_are_served() -> None:
    async with served() as here, aiohttp.ClientSession() as session:
        for name, status in NAMES.items():
            async with session.get(here.address, headers={"Host": name}) as answer:
                assert answer.status == status
                assert answer.headers["X-Frame-Options"] == "DENY"
                assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        async with session.get(here.address) as answer:
            assert answer.status == 200


async def test_another_page_in_the_same_browser_gets_no_socket() -> None:
    async with served() as here, aiohttp.ClientSession() as session:
        for headers in ({}, {"Origin": "http://evil.example"}):
            async with session.get(f"{here.address}ws", headers=headers) as answer:
                assert answer.status == 403
        async with session.get(f"{here.address}ws", headers=here.origin) as answer:
            assert answer.status == 401  # no session


async def test_elsewhere_than_on_loopback_a_token_is_asked_for() -> None:
    async with served(host="0.0.0.0") as here, aiohttp.ClientSession() as session:
        base, token = here.address.replace("0.0.0.0", "127.0.0.1").split("#")
        origin = {"Origin": base.rstrip("/")}
        for body, status in (("wrong", 401), (token, 204)):
            async with session.post(f"{base}session", data=body, headers=origin) as answer:
                assert answer.status == status
        for headers, status in (({}, 401), ({"Authorization": f"Bearer {token}"}, 200)):
            async with session.get(f"{base}metrics", headers=headers) as answer:
                assert answer.status == status


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A certificate for this computer, made for the purpose, and its key."""
    if which("openssl") is None:
        pytest.skip("no openssl here to make a certificate with")
    folder = tmp_path_factory.mktemp("tls")
    certificate, key = str(folder / "cert.pem"), str(folder / "key.pem")
    make = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2"
    names = ["-subj", "/CN=robot", "-addext", "subjectAltName=IP:127.0.0.1"]
    command = [*make.split(), *names, "-keyout", key, "-out", certificate]
    subprocess.run(command, check=True, capture_output=True)
    return certificate, key


async def test_with_a_certificate_page_and_socket_are_encrypted(pair: tuple[str, str]) -> None:
    trusting = ssl.create_default_context(cafile=pair[0])
    async with (
        served(certificate=pair[0], key=pair[1]) as here,
        aiohttp.ClientSession(connector=aiohttp.TCPConnector(ssl=trusting)) as session,
    ):
        assert here.address.startswith("https://127.0.0.1:")
        async with session.post(f"{here.address}session", headers=here.origin) as answer:
            assert answer.status == 204
            cookie = answer.cookies[COOKIE]
        assert cookie["secure"]
        assert cookie["httponly"]
        assert cookie["samesite"] == "Strict"
        known = here.origin | {"Cookie": f"{COOKIE}={cookie.value}"}
        async with session.ws_connect(f"{here.address}ws", headers=known) as socket:
            assert "state" in await socket.receive_json()
        with pytest.raises(aiohttp.ClientError):
            await session.get(here.address.replace("https", "http"))


async def test_files_that_are_no_certificate_are_named(pair: tuple[str, str]) -> None:
    for certificate, key in (("/nowhere.pem", None), (pair[1], None), (pair[0], pair[0])):
        with pytest.raises(DeviceError, match="PEM files of a pair"):
            encryption(WebSection(certificate=certificate, key=key))
    with pytest.raises(ValueError, match="nothing is encrypted"):
        WebSection(key=pair[1])


async def test_metrics_and_health_are_served() -> None:
    async with served() as here, aiohttp.ClientSession() as session:
        await clock.sleep(0.9)
        async with session.get(f"{here.address}metrics") as answer:
            text = await answer.text()
        assert 'followerd_stream_age_seconds{stream="scan"}' in text
        assert 'followerd_mode{mode="disarmed"} 1.0' in text
        for device in ("base", "laser", "camera"):
            assert f'followerd_device_errors_total{{device="{device}"}} 0.0' in text
        async with session.get(f"{here.address}healthz") as answer:
            assert answer.status == 200
            assert (await answer.json())["mode"] == "disarmed"
        for recovered in (False, False, True, False):  # tried again, back, gone
            here.daemon.handle(
                Fault(clock.now(), "laser", StopReason.LINK_LOST, "gone", recovered=recovered)
            )
        async with session.get(f"{here.address}metrics") as answer:
            assert 'followerd_device_losses_total{device="laser"} 2.0' in await answer.text()


@pytest.mark.slow
def test_broken_telegrams_and_packets_are_counted_by_device() -> None:
    async def errors() -> list[dict[str, int]]:
        faults = ["laser:flip@2s+2s", "robot:flip@2s+2s"]
        chosen = config.load("legs-sim", {"sim.faults": faults, "operator": "manual"})
        world, found = app.rig(chosen), list[dict[str, int]]()
        daemon = app.build(chosen, app.in_memory(world))
        running = asyncio.ensure_future(clock.together(world.run(), daemon.run()))
        for _ in range(2):
            await clock.sleep(2.0)
            found.append(daemon.errors())
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        return found

    before, after = clock.run_virtual(errors())
    assert before == {"base": 0, "laser": 0, "camera": 0}
    assert after["base"] > 0
    assert after["laser"] > 0
    assert after["camera"] == 0


async def test_who_does_not_command_only_looks_and_stops() -> None:
    async with served() as here, opened(here) as first, opened(here) as second:
        assert (await first.ask("command"))["ok"]
        assert (await second.ask("command"))["error"] == "somebody else commands"
        assert "take the command first" in (await second.ask("confirm"))["error"]
        assert (await second.ask("stop"))["ok"]
        await first.until("estop")
        assert (await first.ask("clear"))["ok"]
        await second.until("disarmed")


@pytest.mark.slow
async def test_nonsense_is_answered_and_in_the_end_thrown_out() -> None:
    async with served() as here, opened(here) as talk:
        for _ in range(19):
            await talk.socket.send_str("{")
            assert not (await talk.answer())["ok"]
        assert (await talk.ask("command"))["ok"]  # good again
        for _ in range(25):
            await talk.socket.send_str("nonsense")
        while (message := await talk.socket.receive(5.0)).type is not aiohttp.WSMsgType.CLOSE:
            assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY)
        assert doing(here) == (Mode.DISARMED, True)


@pytest.mark.slow
@pytest.mark.realtime
async def test_a_hundred_thousand_odd_messages_neither_crash_nor_command() -> None:
    async with served() as here:
        await clock.sleep(1.0)
        outcome = await fuzz(here, np.random.default_rng(8), 97_000, 2000, 1000)
    assert outcome.counts["refused"] > 80_000


@pytest.mark.slow
async def test_a_flood_is_cut_off_and_the_daemon_goes_on() -> None:
    async with served() as here, opened(here) as talk:
        closed = False
        for _ in range(2000):
            if talk.socket.closed:
                break
            try:
                await talk.say("alive")
            except ConnectionError:
                break
        while not closed:
            kind = (await talk.socket.receive(5.0)).type
            closed = kind in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
        async with opened(here) as other:
            assert (await other.ask("command"))["ok"]


@pytest.mark.slow
@pytest.mark.realtime
async def test_the_robot_stops_within_a_second_of_the_commander_and_by_hand_sooner() -> None:
    async with served() as here:
        async with opened(here) as talk:
            await talk.until("disarmed")
            await asyncio.sleep(2.5)
            assert (await talk.ask("command"))["ok"]
            await talk.insist("manual")
            await talk.until("manual")
            for _ in range(30):
                await talk.say("drive", forward=0.5, left=0.0)
                await asyncio.sleep(0.05)
            assert doing(here) == (Mode.MANUAL, False)
            await asyncio.sleep(0.25)  # F14: the hand lets go
            assert doing(here) == (Mode.MANUAL, True)
            await talk.socket.close()
        await asyncio.sleep(0.3)
        assert doing(here) == (Mode.DISARMED, True)


@pytest.mark.slow
@pytest.mark.realtime
async def test_a_commander_who_falls_silent_stops_the_robot_within_a_second() -> None:
    async with served() as here, opened(here) as talk:
        await asyncio.sleep(3.0)
        assert (await talk.ask("command"))["ok"]
        await talk.newest_frame()
        assert (await talk.ask("enrol", region=[74, 11, 41, 100], frame=talk.frame))["ok"]
        assert (await talk.ask("confirm"))["ok"]
        await talk.insist("arm")
        await talk.until("following")
        await asyncio.sleep(1.1)  # the socket stays open
        assert doing(here) == (Mode.DISARMED, True)


@pytest.mark.slow
@pytest.mark.realtime
async def test_another_tracker_is_chosen_only_while_disarmed() -> None:
    async with served() as here, opened(here) as talk:
        await asyncio.sleep(3.0)
        assert (await talk.ask("command"))["ok"]
        assert (await talk.ask("manual"))["ok"]
        assert (await talk.ask("choose", tracker="ofkf"))["error"] == "disarm first"
        assert (await talk.ask("disarm"))["ok"]
        assert (await talk.ask("choose", tracker="ofkf"))["ok"]
        assert here.chosen == ["ofkf"]


async def test_each_viewer_gets_the_picture_it_asks_for_however_many_ask(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    encoded: list[int] = []

    def encode(image: Image) -> bytes:
        encoded.append(image.id)
        time.sleep(0.02)
        return bytes([image.id])

    async with served() as here:
        hub = here.page.hub
        monkeypatch.setattr(hub, "_encode", encode)
        seen = await newest(here)
        first, second = replace(seen, id=7), replace(seen, id=8)
        asked = [first, first, second, second]
        sent = await asyncio.gather(*[hub.picture(image) for image in asked])
        assert [HEADER.unpack(message[: HEADER.size])[1] for message in sent] == [7, 7, 8, 8]
        assert [message[HEADER.size :] for message in sent] == [b"\7", b"\7", b"\x08", b"\x08"]
        assert encoded == [7, 8]


def test_a_track_is_told_with_each_image_and_seldom_between() -> None:
    told: list[str] = []

    def look(daemon: Daemon) -> None:
        hub = Hub(daemon, 75, dict)
        hub.attach()
        hub.join(lambda: told.append(hub.track))

    chosen = config.load("hpf-sim")
    simulate(chosen, 3.0, look)
    tracks = [json.loads(text)["track"] for text in dict.fromkeys(told) if text]
    frames = sorted({track["frame"] for track in tracks if track})
    assert frames == list(range(frames[0], frames[0] + len(frames)))
    assert 25 < len(frames) < len(tracks) < 2 * len(frames)
