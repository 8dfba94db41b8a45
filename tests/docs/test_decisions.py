from pathlib import Path

DECISIONS = sorted((Path(__file__).parents[2] / "docs" / "decisions").glob("*.md"))


def test_each_decision_has_the_next_number_and_a_title_with_one_has_the_same():
    numbers = [path.name[:4] for path in DECISIONS]
    assert numbers == [f"{number:04d}" for number in range(1, len(DECISIONS) + 1)]
    for path in DECISIONS:
        first = path.read_text().removeprefix("# ")[:4]
        assert not first.isdigit() or first == path.name[:4], path.name
