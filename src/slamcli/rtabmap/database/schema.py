# SPDX-License-Identifier: MIT
"""Tables, indices and triggers of RTAB-Map's databases, version 0.23.8, and which older ones are read."""

from __future__ import annotations

import re
import sqlite3
from dataclasses import dataclass

from slamcli.errors import FormatError

VERSION = "0.23.8"
"""Of the schema that is written."""
OLDEST = (0, 8, 0)
NEWEST = (0, 23)
_OLD_TABLES = ("Map_Node_Word", "Image", "Depth")
_OPTIONAL = (("Data", "depth_confidence"), ("Admin", "dictionary_index"))
"""Columns that came within 0.22 and 0.23 and are not written."""

TABLES = {
    "Node": "id INTEGER NOT NULL, map_id INTEGER NOT NULL, weight INTEGER, stamp FLOAT, pose BLOB, ground_truth_pose BLOB, velocity BLOB, "
    "label TEXT, gps BLOB, env_sensors BLOB, time_enter DATE, PRIMARY KEY (id)",
    "Data": "id INTEGER NOT NULL, image BLOB, depth BLOB, depth_confidence BLOB, calibration BLOB, scan BLOB, scan_info BLOB, ground_cells BLOB, "
    "obstacle_cells BLOB, empty_cells BLOB, cell_size FLOAT, view_point_x FLOAT, view_point_y FLOAT, view_point_z FLOAT, user_data BLOB, "
    "time_enter DATE, PRIMARY KEY (id)",
    "Link": "from_id INTEGER NOT NULL, to_id INTEGER NOT NULL, type INTEGER NOT NULL, information_matrix BLOB NOT NULL, transform BLOB, "
    "user_data BLOB, FOREIGN KEY (from_id) REFERENCES Node(id), FOREIGN KEY (to_id) REFERENCES Node(id)",
    "Word": "id INTEGER NOT NULL, descriptor_size INTEGER NOT NULL, descriptor BLOB NOT NULL, time_enter DATE, PRIMARY KEY (id)",
    "Feature": "node_id INTEGER NOT NULL, word_id INTEGER NOT NULL, pos_x FLOAT NOT NULL, pos_y FLOAT NOT NULL, size INTEGER NOT NULL, "
    "dir FLOAT NOT NULL, response FLOAT NOT NULL, octave INTEGER NOT NULL, depth_x FLOAT, depth_y FLOAT, depth_z FLOAT, descriptor_size INTEGER, "
    "descriptor BLOB, FOREIGN KEY (node_id) REFERENCES Node(id)",
    "GlobalDescriptor": "node_id INTEGER NOT NULL, type INTEGER NOT NULL, info BLOB, data BLOB NOT NULL, FOREIGN KEY (node_id) REFERENCES Node(id)",
    "Info": "STM_size INTEGER, last_sign_added INTEGER, process_mem_used INTEGER, database_mem_used INTEGER, dictionary_size INTEGER, "
    "parameters TEXT, time_enter DATE",
    "Statistics": "id INTEGER NOT NULL, stamp FLOAT, data BLOB, wm_state BLOB, FOREIGN KEY (id) REFERENCES Node(id)",
    "Admin": "version TEXT, preview_image BLOB, opt_cloud BLOB, opt_ids BLOB, opt_poses BLOB, opt_last_localization BLOB, "
    "opt_polygons_size INTEGER, opt_polygons BLOB, opt_tex_coords BLOB, opt_tex_materials BLOB, opt_map BLOB, opt_map_x_min FLOAT, "
    "opt_map_y_min FLOAT, opt_map_resolution FLOAT, dictionary_index BLOB, time_enter DATE",
}  # fmt: skip

_ENTERED = "CREATE TRIGGER insert_{0}_timeEnter AFTER INSERT ON {0} BEGIN UPDATE {1} SET time_enter = DATETIME('NOW') WHERE rowid = new.rowid; END"
_KNOWN_NODE = (
    "CREATE TRIGGER insert_Feature BEFORE INSERT ON Feature WHEN NOT EXISTS (SELECT Node.id FROM Node WHERE Node.id = NEW.node_id) "
    "BEGIN SELECT RAISE(ABORT, 'Foreign key constraint failed in Feature table'); END"
)
_TRIGGERS = (
    _KNOWN_NODE,
    _ENTERED.format("Node", "Node"),
    _ENTERED.format("Data", "Node"),  # the original's: a row of data marks its node
    _ENTERED.format("Word", "Word"),
    _ENTERED.format("Info", "Info"),
)
_INDICES = (
    "CREATE UNIQUE INDEX IDX_Node_id on Node (id)",
    "CREATE INDEX IDX_Feature_node_id on Feature (node_id)",
    "CREATE INDEX IDX_GlobalDescriptor_node_id on GlobalDescriptor (node_id)",
    "CREATE INDEX IDX_Link_from_id on Link (from_id)",
    "CREATE UNIQUE INDEX IDX_node_label on Node (label)",
    "CREATE UNIQUE INDEX IDX_Statistics_id on Statistics (id)",
)


@dataclass(frozen=True, slots=True)
class Layout:
    """What a database has."""

    version: tuple[int, ...]
    columns: dict[str, tuple[str, ...]]
    """By table."""

    @property
    def text(self) -> str:
        """The version as it stands in the file."""
        return ".".join(str(part) for part in self.version)

    def has(self, table: str, column: str) -> bool:
        """Return whether a table has a column."""
        return column in self.columns.get(table, ())


def create_tables(connection: sqlite3.Connection) -> None:
    """Create everything in an empty database."""
    for name, columns in TABLES.items():
        connection.execute(f"CREATE TABLE {name} ({columns})")
    for statement in (*_TRIGGERS, *_INDICES):
        connection.execute(statement)
    connection.execute("INSERT INTO Admin(version) VALUES(?)", (VERSION,))


def read_layout(connection: sqlite3.Connection, path: str) -> Layout:
    """Return which version a database is of.

    Raises
    ------
    FormatError
        If it is none of RTAB-Map's, or of a version that is not read.
    """
    names = {str(row[0]) for row in connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}
    if not {"Node", "Link", "Admin"} <= names or not names & {"Data", "Image"}:
        shown = ", ".join(sorted(names)[:5]) or "no tables"
        raise FormatError(f"{path}: not a database of RTAB-Map (it has {shown}); give a .db of RTAB-Map or of slamcli")
    row = connection.execute("SELECT version FROM Admin").fetchone()
    text = str(row[0]) if row else ""
    match = re.match(r"^(\d+)\.(\d+)\.(\d+)", text)
    if not match:
        raise FormatError(f"{path}: its version {text!r} is none of RTAB-Map's; it is damaged or another program's")
    version = tuple(int(part) for part in match.groups())
    if not (version >= OLDEST and version[:2] <= NEWEST):
        raise FormatError(f"{path}: written by RTAB-Map {text}; versions 0.8.0 to 0.23 are read")
    known = sorted(names & {*TABLES, *_OLD_TABLES})
    return Layout(
        version,
        {name: tuple(str(row[1]) for row in connection.execute(f"PRAGMA table_info({name})")) for name in known},
    )


def check_extendable(layout: Layout, path: str) -> None:
    """Raise FormatError where a database lacks columns that are written."""
    for table in TABLES:
        for column in column_names(table):
            if not layout.has(table, column) and (table, column) not in _OPTIONAL and table != "GlobalDescriptor":
                raise FormatError(
                    f"{path}: written by RTAB-Map {layout.text}, without {table}.{column}: it can be read, but not continued; "
                    "map it again into a new database (slamcli map --algo rtabmap OLD.db)"
                )


def column_names(table: str) -> tuple[str, ...]:
    """Return the columns that a table has today."""
    return tuple(re.findall(r"(?:^|, )([A-Za-z_]+) (?:INTEGER|FLOAT|BLOB|TEXT|DATE)", TABLES[table]))
