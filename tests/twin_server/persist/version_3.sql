create table twins (
  id text primary key,
  place integer not null,
  site text not null,
  asset text not null,
  registration text not null,
  checkpoint text not null
);
create table runs (
  number integer primary key,
  twin text not null,
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
  slow_last real,
  slow_rises integer not null default 1,
  unique (site, asset, boot)
);
create index runs_of_twin on runs (twin, number);
create table features (
  id integer primary key,
  t_ns integer not null,
  slow_time real not null,
  message blob not null,
  state blob not null
);
-- Of twins of elements only. Version 1 had no such table.
create table details (
  id integer primary key,
  changes blob not null,
  body blob not null
);
create table held (
  number integer not null,
  sequence integer not null,
  message blob not null,
  primary key (number, sequence)
) without rowid;
create table events (
  number integer primary key autoincrement,
  twin text not null,
  site text not null,
  asset text not null,
  t_ns integer not null,
  slow_time real,
  derived integer not null,
  body text not null
);
create index events_of_twin on events (twin, number);
create table numbers (what text primary key, value integer not null);
create table diagnoses (
  number integer primary key autoincrement,
  twin text not null,
  asked_ns integer not null,
  ended_ns integer,
  state text not null,
  request text not null,
  error text not null,
  report text,
  page blob,
  model text
);
create index diagnoses_of_twin on diagnoses (twin, number);
