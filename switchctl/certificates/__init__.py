"""Certificates: claims with their witnesses, as JSON, which `check.py` decides by itself."""

from switchctl.certificates.optimum import Certificate, certify

__all__ = ["Certificate", "certify"]
