//! The command `lenscube`.

use std::process::ExitCode;

fn main() -> ExitCode {
    lenscube::main()
}
