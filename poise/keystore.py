"""SROS 2 keystores: certificates and signed permissions for nodes, from their policy files, by the program openssl.

The layout and the permissions are those of `ros2 security` (sros2 0.10 and later). The middleware has to be built with
security, as that of the Debian packages of ROS 2 Jazzy is.
"""

import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from poise.errors import ErrorCode, InputError
from poise.files import write_whole

_DAYS = 3650
_AUTHORITIES = ("identity_ca", "permissions_ca")
_ACTION_SERVICES = ("send_goal", "cancel_goal", "get_result")
_ACTION_TOPICS = ("feedback", "status")
_GOVERNANCE = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
  <domain_access_rules><domain_rule>
    <domains><id_range><min>0</min><max>232</max></id_range></domains>
    <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
    <enable_join_access_control>true</enable_join_access_control>
    <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
    <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
    <rtps_protection_kind>SIGN</rtps_protection_kind>
    <topic_access_rules><topic_rule>
      <topic_expression>*</topic_expression>
      <enable_discovery_protection>true</enable_discovery_protection>
      <enable_liveliness_protection>true</enable_liveliness_protection>
      <enable_read_access_control>true</enable_read_access_control>
      <enable_write_access_control>true</enable_write_access_control>
      <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
      <data_protection_kind>ENCRYPT</data_protection_kind>
    </topic_rule></topic_access_rules>
  </domain_rule></domain_access_rules>
</dds>
"""
_PERMISSIONS = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions><grant name="{enclave}">
    <subject_name>CN={enclave}</subject_name>
    <validity><not_before>{begin}</not_before><not_after>{end}</not_after></validity>
    <allow_rule>
      <domains><id>{domain}</id></domains>
      <publish><topics>{publish}</topics></publish>
      <subscribe><topics>{subscribe}</topics></subscribe>
    </allow_rule>
    <default>DENY</default>
  </grant></permissions>
</dds>
"""


@dataclass(frozen=True)
class NodePolicy:
    """What one node may do.

    Args:
        node, namespace: of the node.
        allowed: names by (element, access): ("topic", "publish"), ("topic", "subscribe"), ("service", "reply"),
            ("service", "request"), ("action", "execute"), ("action", "call"); absolute.
    """

    node: str
    namespace: str
    allowed: Mapping[tuple[str, str], frozenset[str]]

    def dds_topics(self, publish: bool) -> set[str]:
        """Names of the DDS topics that the node may publish, or subscribe to."""
        names = {"ros_discovery_info"}
        names |= {f"rt{name}" for name in self.allowed.get(("topic", "publish" if publish else "subscribe"), ())}
        for access, server in (("reply", True), ("request", False)):
            for name in self.allowed.get(("service", access), ()):
                names.add(f"rr{name}Reply" if publish == server else f"rq{name}Request")
        for access, server in (("execute", True), ("call", False)):
            for name in self.allowed.get(("action", access), ()):
                for service in _ACTION_SERVICES:
                    end = f"{name}/_action/{service}"
                    names.add(f"rr{end}Reply" if publish == server else f"rq{end}Request")
                if publish == server:
                    names |= {f"rt{name}/_action/{topic}" for topic in _ACTION_TOPICS}
        return names


def read_policy(
    path: Path, namespace: str = "/", remaps: Mapping[str, str] | None = None
) -> dict[str, list[NodePolicy]]:
    """The policies of a file of sros2, by enclave.

    Args:
        path: of the file.
        namespace: of its nodes.
        remaps: relative topic or service name -> the name that it is remapped to.

    Raises:
        InputError: FILE_UNREADABLE; FILE_CORRUPT when it is not such a file.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
    try:
        if "<!" in text.replace("<!--", ""):
            raise ValueError("a document type or an entity")
        root = ElementTree.fromstring(text)
        return {
            enclave.attrib["path"]: [_policy(profile, namespace, remaps or {}) for profile in enclave.iter("profile")]
            for enclave in root.iter("enclave")
        }
    except (ElementTree.ParseError, KeyError, ValueError) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path} is not a policy file of sros2: {error}") from error


def _policy(profile: ElementTree.Element, namespace: str, remaps: Mapping[str, str]) -> NodePolicy:
    node = profile.attrib["node"]
    allowed: dict[tuple[str, str], frozenset[str]] = {}
    for group in profile:
        kind = group.tag.removesuffix("s")
        names = frozenset(_full(entry.text or "", node, namespace, remaps) for entry in group)
        for access, permission in group.attrib.items():
            if permission != "ALLOW":
                raise ValueError(f"{access} of {group.tag} is {permission}: only ALLOW is read, all else is denied")
            allowed[kind, access] = allowed.get((kind, access), frozenset()) | names
    return NodePolicy(node, namespace, allowed)


def _full(name: str, node: str, namespace: str, remaps: Mapping[str, str]) -> str:
    name, base = remaps.get(name.strip(), name.strip()), namespace.rstrip("/")
    if name.startswith("~/"):
        return f"{base}/{node}{name[1:]}"
    return name if name.startswith("/") else f"{base}/{name}"


def make_keystore(folder: Path) -> None:
    """Make authorities and the governance, unless there are some.

    Raises:
        InputError: FILE_UNWRITABLE; UNSUPPORTED without the program openssl.
    """
    public, private = folder / "public", folder / "private"
    if (public / "identity_ca.cert.pem").exists():
        return
    _make_folder(public)
    _make_folder(private)
    private.chmod(0o700)
    for name in _AUTHORITIES:
        key, certificate = private / f"{name}.key.pem", public / f"{name}.cert.pem"
        _make_key(key)
        _openssl(
            "req", "-x509", "-new", "-key", key, "-sha256", "-days", _DAYS, "-subj", f"/CN={name}", "-out", certificate
        )
    governance = write_whole(folder / "enclaves" / "governance.xml", _GOVERNANCE.encode())
    _sign(folder, governance)


def add_enclave(folder: Path, enclave: str, policies: list[NodePolicy], domain: int = 0) -> Path:
    """Make key, certificate and signed permissions of an enclave; returns its folder. An existing key is kept.

    Args:
        folder: of the keystore.
        enclave: absolute name, such as /poise/ft_driver.
        policies: of the nodes in it.
        domain: ROS domain.

    Raises:
        InputError: as `make_keystore`; BAD_INPUT for a name that is none.
    """
    if not enclave.startswith("/") or any(not part.isidentifier() for part in enclave[1:].split("/")):
        raise InputError(ErrorCode.BAD_INPUT, f"{enclave!r} is no enclave: give a name such as /poise/ft_driver")
    make_keystore(folder)
    own = folder / "enclaves" / enclave[1:]
    _make_folder(own)
    key, certificate = own / "key.pem", own / "cert.pem"
    if not key.exists():
        _make_key(key)
        _certify(folder, key, certificate, enclave)
    for name, target in (
        ("identity_ca.cert.pem", folder / "public" / "identity_ca.cert.pem"),
        ("permissions_ca.cert.pem", folder / "public" / "permissions_ca.cert.pem"),
        ("governance.p7s", folder / "enclaves" / "governance.p7s"),
    ):
        write_whole(own / name, target.read_bytes())
    permissions = write_whole(own / "permissions.xml", permissions_of(enclave, policies, domain).encode())
    _sign(folder, permissions)
    return own


def permissions_of(enclave: str, policies: list[NodePolicy], domain: int) -> str:
    """The DDS permissions of an enclave, XML."""

    def topics(publish: bool) -> str:
        names = sorted(set().union(*(policy.dds_topics(publish) for policy in policies)))
        return "".join(f"\n        <topic>{escape(name)}</topic>" for name in names)

    now = datetime.now(UTC)
    return _PERMISSIONS.format(
        enclave=escape(enclave),
        begin=(now - timedelta(days=1)).strftime("%Y-%m-%dT%H:%M:%S"),
        end=(now + timedelta(days=_DAYS)).strftime("%Y-%m-%dT%H:%M:%S"),
        domain=domain,
        publish=topics(True),
        subscribe=topics(False),
    )


def _certify(folder: Path, key: Path, certificate: Path, enclave: str) -> None:
    authority = (
        "-CA",
        folder / "public" / "identity_ca.cert.pem",
        "-CAkey",
        folder / "private" / "identity_ca.key.pem",
    )
    with tempfile.TemporaryDirectory() as scratch:
        request = Path(scratch) / "request.pem"
        _openssl("req", "-new", "-key", key, "-subj", "/CN=" + enclave.replace("/", "\\/"), "-out", request)
        serial = ("-CAserial", Path(scratch) / "serial", "-CAcreateserial")
        _openssl("x509", "-req", "-in", request, *authority, *serial, "-sha256", "-days", _DAYS, "-out", certificate)


def _sign(folder: Path, document: Path) -> None:
    signer = ("-signer", folder / "public" / "permissions_ca.cert.pem")
    key = ("-inkey", folder / "private" / "permissions_ca.key.pem")
    _openssl("smime", "-sign", "-text", "-in", document, *signer, *key, "-out", document.with_suffix(".p7s"))


def _make_key(path: Path) -> None:
    _openssl("ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", path)
    path.chmod(0o600)


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNWRITABLE, f"cannot make {path}: {error.strerror}") from error


def _openssl(*arguments: object) -> None:
    command = ["openssl", *map(str, arguments)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    except FileNotFoundError:
        raise InputError(ErrorCode.UNSUPPORTED, "the program openssl is not installed: apt install openssl") from None
    if done.returncode:
        reason = next(_lines(done.stderr), "no reason given")
        raise InputError(ErrorCode.FILE_UNWRITABLE, f"openssl {arguments[0]}: {reason}")


def _lines(text: str) -> Iterator[str]:
    return (line for line in text.splitlines() if line.strip())
