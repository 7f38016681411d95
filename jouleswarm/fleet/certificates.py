"""A certificate authority for one deployment: X.509 certificates on the curve P-256 (RFC 5280)."""

from __future__ import annotations

import datetime
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

Key = ec.EllipticCurvePrivateKey

_SLACK = datetime.timedelta(minutes=5)  # clocks of two machines differ


@dataclass(frozen=True)
class Certified:
    """A certificate and its private key."""

    certificate: x509.Certificate
    key: Key

    @property
    def certificate_pem(self) -> bytes:
        """For a .crt file."""
        return self.certificate.public_bytes(serialization.Encoding.PEM)

    @property
    def key_pem(self) -> bytes:
        """For a .key file, unencrypted."""
        return self.key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )


@dataclass(frozen=True)
class Validity:
    """From when until when certificates hold."""

    start: datetime.datetime
    end: datetime.datetime

    @classmethod
    def days_from(cls, now: datetime.datetime, days: int) -> Validity:
        """`days` from now on."""
        return cls(now - _SLACK, now + datetime.timedelta(days=days))


def make_ca(name: str, validity: Validity) -> Certified:
    """A new authority, signed by itself, that signs certificates of processes only."""
    key = ec.generate_private_key(ec.SECP256R1())
    usage = _usage(key_cert_sign=True, crl_sign=True)
    builder = (
        _builder(name, key, validity, issuer=_name(name))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
    )
    return Certified(builder.sign(key, hashes.SHA256()), key)


def make_server(ca: Certified, hosts: Sequence[str], validity: Validity) -> Certified:
    """A certificate for a broker that is reached by these host names and addresses."""
    names = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
    return _make(ca, hosts[0], validity, ExtendedKeyUsageOID.SERVER_AUTH, names)


def make_client(ca: Certified, name: str, validity: Validity) -> Certified:
    """A certificate for the client called `name`."""
    return _make(ca, name, validity, ExtendedKeyUsageOID.CLIENT_AUTH)


def serves(certificate_pem: bytes, hosts: Sequence[str], left: datetime.timedelta) -> bool:
    """Whether a server's certificate is for just these hosts and holds for at least `left` from now."""
    certificate = x509.load_pem_x509_certificate(certificate_pem)
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    end = certificate.not_valid_after_utc
    return list(names) == [_general_name(host) for host in hosts] and end >= datetime.datetime.now(datetime.UTC) + left


def _make(
    ca: Certified,
    name: str,
    validity: Validity,
    purpose: x509.ObjectIdentifier,
    names: x509.SubjectAlternativeName | None = None,
) -> Certified:
    key = ec.generate_private_key(ec.SECP256R1())
    builder = (
        _builder(name, key, validity, issuer=ca.certificate.subject)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(digital_signature=True), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(ca.key.public_key()), critical=False)
    )
    if names is not None:
        builder = builder.add_extension(names, critical=False)
    return Certified(builder.sign(ca.key, hashes.SHA256()), key)


def _builder(name: str, key: Key, validity: Validity, issuer: x509.Name) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(_name(name))
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(validity.start)
        .not_valid_after(validity.end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _usage(**wanted: bool) -> x509.KeyUsage:
    names = (
        "digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement",
        "key_cert_sign", "crl_sign", "encipher_only", "decipher_only",
    )  # fmt: skip
    return x509.KeyUsage(**{name: wanted.get(name, False) for name in names})


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
