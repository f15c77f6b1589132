"""All proofs: importing the groups enters them."""

from proofs import (  # noqa: F401  # enters their proofs
    group_a_flood,
    group_a_frames,
    group_a_mqtt,
    group_a_payloads,
    group_a_places,
    group_a_strangers,
    group_a_wire,
    group_b_access,
    group_b_broker,
    group_b_threads,
    group_b_verdicts,
    group_c_broker,
    group_c_ports,
    group_c_reads,
    group_d,
    group_d_mute,
    group_e_config,
    group_e_streams,
    group_e_time,
    group_e_watch,
    group_f_log,
)
from proofs.figures import PROOFS

__all__ = ["PROOFS"]
