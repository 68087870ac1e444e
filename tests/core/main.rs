//! Public behaviour, properties, agreement, tables of the papers: one test binary.

mod smoke;
