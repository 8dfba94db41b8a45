"""What decides a diagnosis: the steps, guards and thresholds without which an answer differs.

    python -m tests.what_decides --battery var/blind/1 --battery var/third_party_rigs --hours 8

Each case is diagnosed once, and it is noted which steps and guards act. Then it is diagnosed
again without each of these; and with thresholds halved and doubled, many at once, and fewer of
them where the answer differs, until it is known which of them decide. What is done already is
not done again: a run may be ended at any time, and goes on where it ended.
"""
