//! `lenscube sensor` from outside: films to raws.

mod angles;
mod bad_input;
mod bits;
mod catalogue;
mod crosstalk;
mod interruption;
mod light;
mod motion;
mod range;
mod stored;
mod time;

const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const WRONG: i32 = 4;
