-- The store's tables as the oldest version wrote them whose stores are still opened. Later steps: migrations.py.

CREATE TABLE run (
    id INTEGER PRIMARY KEY,
    task TEXT NOT NULL,
    policy TEXT NOT NULL,
    policy_key TEXT NOT NULL,
    spec TEXT NOT NULL,
    strategy TEXT NOT NULL,
    budget INTEGER NOT NULL,
    batch INTEGER NOT NULL,
    seed INTEGER NOT NULL,
    repeats INTEGER NOT NULL,
    criteria TEXT NOT NULL,
    stop_early INTEGER NOT NULL,
    min_distance REAL NOT NULL,
    operators TEXT NOT NULL,
    operators_digest TEXT NOT NULL,
    catalogue_digest TEXT NOT NULL,
    simulator TEXT NOT NULL,
    versions TEXT NOT NULL,
    "commit" TEXT,
    command TEXT NOT NULL,
    status TEXT NOT NULL DEFAULT 'running'
        CHECK (status IN ('running', 'finished', 'stopped', 'interrupted', 'failed')),
    started TEXT NOT NULL,
    ended TEXT,
    seconds REAL,
    search_seconds REAL,
    store_seconds REAL,
    packs TEXT NOT NULL DEFAULT '[]',
    robot TEXT NOT NULL DEFAULT 'panda',
    checkup TEXT NOT NULL DEFAULT '',
    placement TEXT NOT NULL DEFAULT 'resting',
    scene_file TEXT NOT NULL DEFAULT '',
    source TEXT NOT NULL DEFAULT '',
    visible TEXT NOT NULL DEFAULT '',
    place TEXT NOT NULL DEFAULT '',
    label TEXT NOT NULL DEFAULT ''
) STRICT;

CREATE TABLE scene (digest TEXT PRIMARY KEY, json TEXT NOT NULL) STRICT;

CREATE TABLE trial (
    id INTEGER PRIMARY KEY,
    run INTEGER NOT NULL REFERENCES run,
    proposal INTEGER NOT NULL,
    scene TEXT NOT NULL REFERENCES scene,
    genome BLOB,
    verdict TEXT NOT NULL CHECK (verdict IN ('error', 'invalid', 'passed', 'failed')),
    progress REAL,
    severity REAL,
    lost_stage TEXT,
    cell TEXT,
    detail TEXT NOT NULL,
    check_name TEXT NOT NULL,
    duplicate INTEGER NOT NULL CHECK (duplicate IN (0, 1)),
    seconds REAL NOT NULL,
    UNIQUE (run, proposal)
) STRICT;

CREATE INDEX trial_scene ON trial (scene);

CREATE TABLE rollout (
    trial INTEGER NOT NULL REFERENCES trial,
    number INTEGER NOT NULL,
    success_once INTEGER NOT NULL CHECK (success_once IN (0, 1)),
    success_at_end INTEGER NOT NULL CHECK (success_at_end IN (0, 1)),
    published_success INTEGER NOT NULL CHECK (published_success IN (0, 1)),
    reached TEXT NOT NULL,
    progress REAL,
    steps INTEGER NOT NULL,
    trace BLOB NOT NULL,
    actions BLOB,
    states_hash TEXT NOT NULL,
    seconds REAL NOT NULL,
    PRIMARY KEY (trial, number)
) STRICT, WITHOUT ROWID;

CREATE TABLE finding (
    id INTEGER PRIMARY KEY,
    scene TEXT NOT NULL REFERENCES scene,
    policy_key TEXT NOT NULL,
    run INTEGER NOT NULL REFERENCES run,
    trial INTEGER NOT NULL REFERENCES trial,
    cell TEXT NOT NULL,
    UNIQUE (scene, policy_key)
) STRICT;

-- Lists of operators, counterparts by operator, and thresholds are JSON.
CREATE TABLE triage (
    scene TEXT NOT NULL REFERENCES scene,
    policy_key TEXT NOT NULL,
    detail TEXT NOT NULL,
    repeats INTEGER NOT NULL,
    failures INTEGER NOT NULL,
    deviating TEXT NOT NULL,
    shrunk TEXT REFERENCES scene,
    lost_stage TEXT,
    operators TEXT NOT NULL,
    necessary TEXT NOT NULL,
    sufficient TEXT NOT NULL,
    thresholds TEXT NOT NULL,
    counterparts TEXT NOT NULL,
    signature TEXT,
    witness_actions BLOB,
    witness_hash TEXT,
    witness_grasp INTEGER,
    shrink_rollouts INTEGER NOT NULL,
    policy_rollouts INTEGER NOT NULL,
    expert_rollouts INTEGER NOT NULL,
    seconds REAL NOT NULL,
    ended TEXT NOT NULL,
    bucket TEXT NOT NULL DEFAULT 'flaky'
        CHECK (bucket IN ('minimal', 'witnessed', 'base', 'unproven', 'edge', 'flaky')),
    rate TEXT NOT NULL DEFAULT 'null',
    certified TEXT NOT NULL DEFAULT 'null',
    counterpart_rates TEXT NOT NULL DEFAULT '{}',
    reference TEXT REFERENCES scene,
    witness_solver TEXT,
    PRIMARY KEY (scene, policy_key)
) STRICT;

-- A run that looks for causes has one row in ``attribution``, and one in ``cause`` for each of them.
CREATE TABLE attribution (
    run INTEGER PRIMARY KEY REFERENCES run,
    unexplained INTEGER NOT NULL,
    probability REAL,
    low REAL,
    high REAL,
    at_random TEXT NOT NULL DEFAULT '[]'
) STRICT;

CREATE TABLE cause (
    run INTEGER NOT NULL REFERENCES attribution,
    rank INTEGER NOT NULL,
    scene TEXT REFERENCES scene,
    operators TEXT NOT NULL,
    failures INTEGER NOT NULL,
    share REAL,
    low REAL,
    high REAL,
    PRIMARY KEY (run, rank)
) STRICT;

-- The expert's, as demonstrations: without an attempt where none solves the scene.
CREATE TABLE solution (
    scene TEXT NOT NULL REFERENCES scene,
    "key" TEXT NOT NULL,
    attempt INTEGER,
    width INTEGER NOT NULL,
    actions BLOB NOT NULL,
    PRIMARY KEY (scene, "key")
) STRICT;

-- Rollouts of a triage that was interrupted, for the next one that is made in the same way.
CREATE TABLE repeat (
    run INTEGER NOT NULL REFERENCES run,
    made TEXT NOT NULL,
    scene TEXT NOT NULL,
    number INTEGER NOT NULL,
    verdict TEXT NOT NULL,
    lost TEXT,
    rollouts INTEGER NOT NULL,
    PRIMARY KEY (run, made, scene, number)
) STRICT;
