"""Blind trials from Python: cases are sealed, verdicts scored as docs/PROOF.md says."""

import hashlib
import json

import pkm
import pytest
from pkm import prove


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two cases of a five-bar, diagnosed: one with something concealed, one with nothing."""
    folder = tmp_path_factory.mktemp("proof")
    seals = prove.make(folder, 2, seed=5, robots=["five_bar"], levels=["L0", "L6"], sizes=[16.0])
    assert prove.diagnose(folder) == 2
    return folder, seals


def test_seals_are_the_hashes_of_the_answers(run):
    folder, seals = run
    assert prove.seals(folder) == seals and list(seals) == ["0001", "0002"]
    for name, seal in seals.items():
        assert hashlib.sha256((folder / "answers" / f"{name}.json").read_bytes()).hexdigest() == seal
        # What is public says nothing of the answer.
        answer = json.loads((folder / "answers" / f"{name}.json").read_text(encoding="utf-8"))
        public = "".join(p.read_text(encoding="utf-8") for p in (folder / "cases" / name).iterdir())
        assert answer["salt"] not in public
    assert prove.diagnose(folder) == 0


def test_marks_follow_from_answer_and_verdict(run):
    folder, _ = run
    for mark in prove.score(folder):
        answer = json.loads((folder / "answers" / f"{mark['case']}.json").read_text(encoding="utf-8"))
        verdict = json.loads((folder / "verdicts" / f"{mark['case']}.json").read_text(encoding="utf-8"))
        said = [f"{f['effect']}@{f['where'][0]}" for f in verdict["findings"]]
        assert mark["said"][: len(said)] == said and mark["level"] == answer["level"]
        anything = bool(said) or verdict["unexplained"]["present"] or verdict["status"] != "ok"
        if answer["concealed"]:
            assert mark["is_detected"] == anything and not mark["is_alarm"]
            truth = answer["concealed"][0]
            first = verdict["findings"][0] if said else None
            right = first is not None and first["effect"] == truth["effect"] and bool(set(first["where"]) & set(truth["where"]))
            assert mark["is_first_right"] == right
        else:
            assert mark["is_alarm"] == anything


def test_a_verdict_that_is_right_is_marked_right(run, tmp_path):
    folder, _ = run
    name = next(m["case"] for m in prove.score(folder) if m["concealed"])
    answer = (folder / "answers" / f"{name}.json").read_text(encoding="utf-8")
    truth = json.loads(answer)["concealed"][0]
    finding = {"effect": truth["effect"], "where": truth["where"], "confidence": 0.9}
    for f, is_right in [(finding, True), ({**finding, "where": ["elsewhere"]}, False), ({**finding, "effect": "spring_of_youth"}, False)]:
        verdict = json.dumps({"status": "ok", "findings": [f]})
        marks = json.loads(pkm._pkm.judge_trial(name, answer, verdict, '{"seconds": 1.0, "exit": 0}'))
        assert marks["is_first_right"] is is_right and marks["is_detected"]
    none = json.loads(pkm._pkm.judge_trial(name, answer, None, '{"seconds": 1.0, "exit": 2}'))
    assert not none["ran"] and not none["is_detected"]


def test_a_broken_seal_is_told(run):
    folder, _ = run
    path = folder / "answers" / "0001.json"
    kept = path.read_text(encoding="utf-8")
    path.write_text(kept.replace("L", "l", 1) + " ", encoding="utf-8")
    try:
        with pytest.raises(ValueError, match="0001.json: changed after it had been sealed"):
            prove.score(folder)
    finally:
        path.write_text(kept, encoding="utf-8")
    assert len(prove.score(folder)) == 2


def test_scores_are_tables(run, tmp_path):
    folder, _ = run
    marks = prove.score(folder)
    table = prove.markdown(marks)
    assert table.startswith("| cases |") and "| all | 2 |" in table
    results = tmp_path / "results.json"
    results.write_text(json.dumps({"schema": "pkm.proof/1", "cases": marks}), encoding="utf-8")
    assert prove.results(results) == marks
    results.write_text("{}", encoding="utf-8")
    with pytest.raises(ValueError, match="pkm.proof/1"):
        prove.results(results)


def test_bad_requests_are_refused(run, tmp_path):
    folder, _ = run
    with pytest.raises(ValueError, match="holds a run already"):
        prove.make(folder, 1)
    for wrong, told in [({"levels": ["L9"]}, "L9"), ({"robots": ["hexapod"]}, "hexapod"), ({"sizes": [-1.0]}, "sizes = ")]:
        with pytest.raises(ValueError, match=told):
            prove.make(tmp_path / "new", 1, **wrong)
    with pytest.raises(ValueError, match="cases = 0"):
        prove.make(tmp_path / "new", 0)
    (tmp_path / "seals.txt").write_text("abc  0001.json\n", encoding="utf-8")
    with pytest.raises(ValueError, match="line 1: not a seal"):
        prove.seals(tmp_path)
