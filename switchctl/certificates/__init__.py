"""Certificates: claims with their witnesses, as JSON, which `check.py` decides by itself."""

from switchctl.certificates.certificate import Certificate
from switchctl.certificates.certify import certify

__all__ = ["Certificate", "certify"]
