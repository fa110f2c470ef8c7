"""The paper, statement by statement: what it says beside what the twins measure."""
