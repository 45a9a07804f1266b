"""A keystore of SROS 2: certificates and signatures that openssl verifies, and permissions that deny all else."""

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.keystore import add_enclave, read_policy

ROOT = Path(__file__).parents[1]
POLICIES = {path.name.partition(".")[0]: path for path in (ROOT / "config" / "sros2").glob("*.policy.xml")}
pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


def openssl(*arguments: object) -> str:
    done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_every_node_has_a_policy() -> None:
    nodes = set(re.findall(r'^    "(\w+)": "poise\.', (ROOT / "setup.py").read_text(), re.M))
    assert set(POLICIES) == nodes
    for name, path in POLICIES.items():
        ((enclave, policies),) = read_policy(path).items()
        assert enclave == f"/poise/{name}"
        assert policies[0].node == name


def test_a_keystore_verifies_and_its_permissions_are_signed(tmp_path: Path) -> None:
    assert run(["keystore", str(tmp_path), "ft_driver", "--namespace", "/arm", "--domain", "7"]) == 0
    own, public = tmp_path / "enclaves" / "poise" / "ft_driver", tmp_path / "public"
    openssl("verify", "-CAfile", public / "identity_ca.cert.pem", own / "cert.pem")
    assert "CN = /poise/ft_driver" in openssl("x509", "-in", own / "cert.pem", "-noout", "-subject")
    for name in ("permissions", "governance"):
        authority = ("-CAfile", public / "permissions_ca.cert.pem")
        signed = openssl("smime", "-verify", "-text", "-in", own / f"{name}.p7s", *authority)
        assert "<dds" in signed
    for key in [*(tmp_path / "private").iterdir(), own / "key.pem"]:
        assert key.stat().st_mode & 0o077 == 0
    root = ElementTree.parse(own / "permissions.xml").getroot()
    assert [entry.text for entry in root.iter("default")] == ["DENY"]
    assert [entry.text for entry in root.iter("id")] == ["7"]
    publish, subscribe = (
        {topic.text for topic in next(root.iter(kind)).iter("topic")} for kind in ("publish", "subscribe")
    )
    assert {"rt/arm/wrench", "rt/diagnostics", "rr/arm/bias_sensorReply", "ros_discovery_info"} <= publish
    assert {"rq/arm/bias_sensorRequest", "rq/arm/ft_driver/get_parametersRequest"} <= subscribe
    assert not any("joint" in name or "*" in name for name in publish | subscribe)
    before = (own / "key.pem").read_bytes()
    assert run(["keystore", str(tmp_path), "ft_driver"]) == 0
    assert (own / "key.pem").read_bytes() == before


def test_actions_and_remaps_become_topics(tmp_path: Path) -> None:
    ((_, policies),) = read_policy(POLICIES["placement_planner"], remaps={"assembly": "hall/assembly"}).items()
    publish = set().union(*(policy.dds_topics(True) for policy in policies))
    subscribe = set().union(*(policy.dds_topics(False) for policy in policies))
    assert {"rr/place_object/_action/send_goalReply", "rt/place_object/_action/feedback"} <= publish
    assert {"rq/place_object/_action/cancel_goalRequest", "rt/hall/assembly"} <= subscribe
    assert "rt/assembly" not in subscribe


@pytest.mark.parametrize(
    "content",
    [
        "",
        "<policy",
        '<!DOCTYPE p [<!ENTITY a "b">]><policy/>',
        '<policy><enclaves><enclave path="/a"><profiles><profile node="n"><topics publish="DENY"/></profile></profiles>'
        "</enclave></enclaves></policy>",
    ],
)
def test_what_is_no_policy_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "own.policy.xml"
    path.write_text(content)
    with pytest.raises(InputError) as found:
        read_policy(path)
    assert found.value.code == ErrorCode.FILE_CORRUPT


def test_an_enclave_stays_inside_the_keystore(tmp_path: Path) -> None:
    for name in ("poise", "/../../etc", "/a b", "/", "/a//b"):
        with pytest.raises(InputError):
            add_enclave(tmp_path, name, [])
    assert run(["keystore", str(tmp_path), "nonsense"]) == 2
