"""Where the link may listen."""

import ipaddress


def parse_address(bind: str, elsewhere: bool) -> tuple[str, int]:
    """The address and port of ``127.0.0.1:9002``.

    Args:
        bind: as it was given.
        elsewhere: whether it may be another address than one of the loopback, which only this machine reaches.

    Raises:
        ValueError: for one that is none, or that other machines reach although nobody said so.
    """
    host, colon, port = bind.rpartition(":")
    host = "127.0.0.1" if host == "localhost" else host
    try:
        address = ipaddress.IPv4Address(host)
    except ValueError:
        address = None
    if not colon or address is None or not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise ValueError(f"bind={bind} is no address of IPv4 and port: give one like bind=127.0.0.1:9002")
    if not address.is_loopback and not elsewhere:
        raise ValueError(
            f"bind={bind} is reached by other machines, and whoever sends packets there flies the vehicle: give "
            "bind=127.0.0.1:9002, or elsewhere=true as well"
        )
    return host, int(port)
