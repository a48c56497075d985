"""Other ways to run the same array, each behind one function; one that is missing is named."""

from cnnum.lab.bench.peers.work import PEERS, Peer, Work, peer_version

__all__ = ["PEERS", "Peer", "Work", "peer_version"]
