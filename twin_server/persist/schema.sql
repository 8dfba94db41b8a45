-- Version 14. A feature's id is number << 40 | sequence: boots are numbered in the order in which
-- they were let in, so that ascending ids are a twin's history in order. Each row has checksums
-- of what it says (see sealing.py).
create table twins (
  id text primary key,
  place integer not null,
  site text not null,
  asset text not null,
  registration text not null,
  checkpoint text not null,
  crc integer not null
);
-- The row of a boot that only grows is behind its features (see twins.py).
create table runs (
  number integer primary key,
  site text not null,
  asset text not null,
  boot text not null,
  slow_time_unit text not null,
  next integer not null,
  last integer not null,
  last_t_ns integer not null,
  told integer not null,
  closed integer not null,
  lost text not null,
  twin text not null,
  slow_last real,
  slow_rises integer not null,
  crc integer not null,
  unique (site, asset, boot)
);
create index runs_of_twin on runs (twin, number);
create table features (
  id integer primary key,
  t_ns integer not null,
  slow_time real not null,
  message blob not null,
  state blob not null,
  message_crc integer not null,
  state_crc integer not null
);
-- Of twins of elements only.
create table details (
  id integer primary key,
  changes blob not null,
  body blob not null,
  changes_crc integer not null,
  body_crc integer not null
);
-- Buckets of consecutive states (see levels.py): of 8^level sequences, from the one of `id` on.
create table levels (
  level integer not null,
  id integer not null,
  bucket blob not null,
  crc integer not null,
  primary key (level, id)
);
-- Hash of a history up to the feature of `id`, and of how many it is (see hashing.py).
create table digests (
  id integer primary key,
  count integer not null,
  sha256 text not null,
  crc integer not null
);
create table held (
  number integer not null,
  sequence integer not null,
  message blob not null,
  crc integer not null,
  primary key (number, sequence)
);
create table events (
  number integer primary key,
  twin text not null,
  site text not null,
  asset text not null,
  t_ns integer not null,
  slow_time real,
  derived integer not null,
  body text not null,
  crc integer not null
);
create index events_of_twin on events (twin, number);
create table diagnoses (
  number integer primary key,
  twin text not null,
  asked_ns integer not null,
  ended_ns integer,
  state text not null,
  request text not null,
  error text not null,
  report text,
  page blob,
  model text,
  crc integer not null,
  files_crc integer not null
);
create index diagnoses_of_twin on diagnoses (twin, number);
-- Events on their way to receivers (see deliveries.py).
create table deliveries (
  id text primary key,
  twin text not null,
  receiver text not null,
  event text not null,
  kind text not null,
  severity text not null,
  reminder integer not null,
  remind_s real not null,
  state text not null,
  tries integer not null,
  created_ns integer not null,
  due_ns integer not null,
  ended_ns integer not null,
  error text not null,
  body text not null,
  crc integer not null
);
create index deliveries_due on deliveries (state, receiver, due_ns);
create index deliveries_of_twin on deliveries (twin, created_ns);
-- Who has taken note of which alarm, by the identity of the event.
create table acknowledgements (
  event text primary key,
  twin text not null,
  t_ns integer not null,
  by_whom text not null,
  principal text not null,
  note text not null,
  crc integer not null
);
create index acknowledgements_of_twin on acknowledgements (twin);
-- Composites as they were registered, one row each time (see compositing.py): the last one of a
-- composite is in force, and an empty `body` says that it was deleted.
create table composites (
  number integer primary key,
  composite text not null,
  t_ns integer not null,
  principal text not null,
  body text not null,
  crc integer not null
);
create index composites_of_id on composites (composite, number);
-- What people have told of an asset, such as a repair (see asset_events.py): `body` is the
-- message, `number` counts the events of a twin.
create table asset_events (
  twin text not null,
  event text not null,
  number integer not null,
  t_ns integer not null,
  principal text not null,
  body text not null,
  crc integer not null,
  primary key (twin, event)
);
create index asset_events_of_twin on asset_events (twin, number);
-- What was accepted, hashed row by row with what was before it (see ledgering.py): blocks of
-- entries of one twin, `count` of them up to the end of this one, whose hash is `link`.
create table ledger (
  twin text not null,
  count integer not null,
  entries blob not null,
  link blob not null,
  crc integer not null,
  primary key (twin, count)
);
-- Signed hashes over the ends of all chains, with those that had changed since the head before.
create table heads (
  number integer primary key,
  t_ns integer not null,
  body text not null,
  crc integer not null
);
-- Newest fatigue message of each boot and hour of sensor time; a message holds sums of its boot.
create table fatigue (
  twin text not null,
  boot text not null,
  hour integer not null,
  sequence integer not null,
  t_ns integer not null,
  message blob not null,
  crc integer not null,
  primary key (twin, boot, hour)
);
-- Messages whose processing exceeded its budget or failed; of those that were dropped and have a
-- place in the history, the place.
create table quarantine (
  number integer primary key,
  twin text not null,
  boot text not null,
  sequence integer not null,
  set_ns integer not null,
  key text not null,
  why text not null,
  accepted integer not null,
  dropped integer not null,
  message blob not null,
  crc integer not null
);
create index quarantine_of_twin on quarantine (twin, boot, sequence);
-- What each twin has stated of its future; `id` names the reading after which it was stated.
create table outlooks (
  twin text not null,
  id integer not null,
  slow_time real not null,
  body text not null,
  crc integer not null,
  primary key (twin, id)
);
-- The last number given to a boot, an event, a diagnosis.
create table numbers (what text primary key, value integer not null, crc integer not null);
