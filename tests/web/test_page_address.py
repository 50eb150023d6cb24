from __future__ import annotations

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.web.address import HttpAddress


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("127.0.0.1:8470", "127.0.0.1", 8470),
        ("8471", "127.0.0.1", 8471),
        ("[::1]:80", "::1", 80),
        ("Localhost:0", "localhost", 0),
    ],
)
def test_addresses_are_understood(text: str, host: str, port: int) -> None:
    assert HttpAddress.parse(text) == HttpAddress(host, port)


@pytest.mark.parametrize("text", ["", ":80", "host", "a:b", "1.2.3.4:99999", "http://a:80", "me@a:80", "a:80/x", "::1"])
def test_nonsense_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(UsageError, match=r"is not HOST:PORT: write, for example, --http 127\.0\.0\.1:8470"):
        HttpAddress.parse(text)


@pytest.mark.parametrize("header", ["localhost:8470", "127.0.0.1:8470", "[::1]:8470", "LOCALHOST", "127.0.0.1"])
def test_loopback_names_are_ours(header: str) -> None:
    assert HttpAddress("127.0.0.1", 8470).is_ours(header)


@pytest.mark.parametrize(
    "header", ["", "evil.example", "evil.example:8470", "127.0.0.1.evil.example", "10.0.0.5:8470", "["]
)
def test_other_names_are_not(header: str) -> None:
    assert not HttpAddress("127.0.0.1", 8470).is_ours(header)


def test_every_number_is_ours_where_we_listen_everywhere() -> None:
    everywhere = HttpAddress.parse("0.0.0.0:8470")
    assert everywhere.is_ours("10.0.0.5:8470")
    assert not everywhere.is_ours("evil.example:8470")


def test_url_can_be_opened_on_this_machine() -> None:
    assert HttpAddress("0.0.0.0", 1).url(8470) == "http://127.0.0.1:8470/"
    assert HttpAddress("::1", 1).url(8470) == "http://[::1]:8470/"
