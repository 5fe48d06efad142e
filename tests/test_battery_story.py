"""A battery that drains while the robot follows somebody, from the base's bytes to the wheels."""

import pytest

from followerd import clock
from followerd.messages import Mode
from followerd.sim.twins.p2os import P2osTwin
from tests.test_daemon import Story, tell

NOTICED = 8.0  # s, a start of the motors must not be taken for it


@pytest.mark.slow
def test_a_draining_battery_warns_limps_and_stops() -> None:
    async def script(story: Story) -> None:
        base = story.rig.robot._twin
        assert isinstance(base, P2osTwin)
        base.status.battery = 11.6
        await story.enrol_and_arm()
        await clock.sleep(4.0)
        for volts, fastest in ((11.45, 0.7), (11.3, 0.32)):
            base.status.battery = volts
            await clock.sleep(NOTICED)
            assert story.is_in(Mode.FOLLOWING)
            assert 0.1 < story.speed <= fastest
            status = await story.ask("status")
            assert any("battery low" in text for text in status["reasons"]), status
        base.status.battery = 11.0
        await clock.sleep(NOTICED)
        assert story.is_in(Mode.DISARMED)
        assert story.speed == pytest.approx(0.0, abs=0.01)
        assert not base.chassis.motors
        refused = await story.ask("arm")
        assert "battery low (base): empty, 11.0 V" in refused["error"]

    tell(script)
