"""What it means that a broker is not let in on, or does not let in: mistakes in keys, which no waiting mends."""

from __future__ import annotations

import ssl

from jouleswarm.common.bus.address import BrokerAddress
from jouleswarm.common.errors import ConfigurationError, JouleSwarmError, RemovedError

SERVER_UNAVAILABLE, BAD_CREDENTIALS = 136, 134  # MQTT 5, section 2.4; paho's names for return codes 3 and 4 too
TLS_ALERT = b"\x15\x03"  # content type and version of a TLS record (RFC 8446, section 5.1)

_EXPIRED, _NOT_YET, _NAMES = 10, 9, (62, 64)  # X509_V_ERR_..., x509_vfy.h of OpenSSL
_ABOUT_OUR_CERTIFICATE = ("CERTIFICATE", "UNKNOWN_CA", "ACCESS_DENIED", "DECRYPT_ERROR")
_ABOUT_TLS = ("PROTOCOL_VERSION", "HANDSHAKE_FAILURE")


class TlsAnswerError(ConnectionError):
    """An answer that begins as a TLS record does, where MQTT was spoken."""


def refusal(error: OSError, address: BrokerAddress) -> ConfigurationError | None:
    """The mistake behind a connection that failed; None where the broker may just be away."""
    text = _mistake(error, address.host)
    return ConfigurationError(f"broker {address}: {text}") if text else None


def connack_refusal(
    reason: int, said: str, address: BrokerAddress, user: str | None, *, was_let_in: bool = False
) -> JouleSwarmError:
    """The mistake behind a CONNACK that refuses (MQTT 3.1.1, section 3.2.2.3); none of one that it let in before."""
    who = f"user {user!r}" if user else "a client without user and password"
    if was_let_in:
        return RemovedError(
            f"broker {address} refused {who}: {said.lower()}, and had let it in before; it is no user any more, or has "
            "another password or other rights: ask whoever keeps the broker's users"
        )
    if reason == BAD_CREDENTIALS or not user:
        hint = "expected a user of the broker's users file and its password; give --keys FOLDER, or both in the URL"
    else:
        hint = "expected a user and certificate of the client's own name, and a last will within its rights"
    return ConfigurationError(f"broker {address} refused {who}: {said.lower()}; {hint}")


def why(error: OSError) -> str:
    """A failed connection in a few words, for a broker that may just be away."""
    if isinstance(error, ssl.SSLEOFError | ssl.SSLZeroReturnError):
        return "the TLS handshake broke off; mqtt:// is the scheme of a port without TLS"
    return error.strerror or str(error)


def closed_early(address: BrokerAddress) -> str:
    """The same for a connection that was closed before CONNACK."""
    return "it closed the connection without an answer" + ("" if address.tls else "; a port with TLS wants mqtts://")


def _mistake(error: OSError, host: str) -> str | None:
    if isinstance(error, TlsAnswerError):
        return "got TLS, expected plain MQTT; give its URL as mqtts://, and --keys FOLDER"
    if isinstance(error, ssl.SSLCertVerificationError):
        return _about_their_certificate(error.verify_code, error.verify_message, host)
    reason = (error.reason or "") if isinstance(error, ssl.SSLError) else ""
    if reason in ("WRONG_VERSION_NUMBER", "RECORD_LAYER_FAILURE"):
        return "got plain bytes, expected TLS; give its URL as mqtt:// if its port has none"
    if "ALERT" not in reason:
        return None
    said = reason.rpartition("ALERT_")[2].replace("_", " ").lower()
    if any(each in reason for each in _ABOUT_OUR_CERTIFICATE):
        return (
            f"it refused this client's certificate ({said}); expected one that its client CA has signed, and not "
            "expired: give --keys FOLDER, or make a new folder with `jouleswarm keys init`"
        )
    return f"it refused the TLS connection ({said})" if any(each in reason for each in _ABOUT_TLS) else None


def _about_their_certificate(code: int, message: str, host: str) -> str:
    got = f"got a certificate that is not valid ({message.rstrip('.')})"
    if code == _EXPIRED:
        return (
            f"{got}, expected one that has not expired; check this machine's clock, or make a new folder of keys with "
            "`jouleswarm keys init`"
        )
    if code == _NOT_YET:
        return f"{got}, expected one that is valid already; check the clocks of both machines"
    if code in _NAMES:
        return f"{got}, expected one for {host}; give the URL with a host of it, or make keys with --hosts {host}"
    return (
        f"{got}, expected one signed by the CA in this client's folder of keys; give the --keys made with the broker's"
    )
