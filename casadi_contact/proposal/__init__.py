"""Proposals of scenes: what two mesh files tell about a joint, tried out and written down."""

from casadi_contact.proposal.propose import Proposal, propose

__all__ = ["Proposal", "propose"]
