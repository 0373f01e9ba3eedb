"""A Ray cluster of two workers on this machine: its address is printed, and it ends where standard input does."""

import socket
import sys
from contextlib import ExitStack

from ray.cluster_utils import Cluster

# Ray waits no more than 15 seconds for the ports that its agents choose, which on a busy machine is too short.
CHOSEN = (
    "metrics_agent_port",
    "metrics_export_port",
    "dashboard_agent_listen_port",
    "runtime_env_agent_port",
)


def node():
    """Return the arguments of a worker with one core, its ports chosen."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in CHOSEN]
        for one in sockets:
            one.bind(("", 0))
        ports = [one.getsockname()[1] for one in sockets]
    return {"num_cpus": 1, "include_dashboard": False, **dict(zip(CHOSEN, ports, strict=True))}


if __name__ == "__main__":
    cluster = Cluster(initialize_head=True, head_node_args={"temp_dir": sys.argv[1], **node()})
    cluster.add_node(**node())
    print(cluster.address, flush=True)
    sys.stdin.read()
    cluster.shutdown()
