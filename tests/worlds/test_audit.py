from vlafuzz.worlds.capabilities import AuditedTask, Defect

SLID = Defect(0, "slides", "bowl slides by 1.2 cm", 0.012)
SLID_MORE = Defect(3, "slides", "bowl slides by 6.2 cm", 0.062)
FALLEN = Defect(3, "falls", "can topples by 90°", 90.0)
TASK = AuditedTask("suite/5", "take the bowl", 10, (FALLEN, SLID_MORE, SLID))


def test_a_state_is_sound_without_any_defect():
    assert TASK.sound == 8
    assert TASK.count("slides") == 2
    assert TASK.count("solved") == 0


def test_alike_defects_are_one_kind_with_its_worst_example():
    assert TASK.kinds() == [(SLID_MORE, 2), (FALLEN, 1)]
