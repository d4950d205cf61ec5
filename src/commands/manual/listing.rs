//! `lenscube man --json`: commands, arguments and exit codes as JSON, from the argument definitions.
//!
//! ```text
//! program, version    strings
//! exit_codes          code, meaning
//! commands            name, about, arguments, commands
//! arguments           name; flag, with its dashes, absent for operands; aliases, its former names; short; value, its name in the help; help; heading; default;
//!                     values, if only these are allowed; takes_value, required, repeatable
//! ```

use crate::failure::code;
use clap::{Arg, ArgAction, Command};
use serde_json::{Map, Value, json};

/// The listing of a program whose command has been built.
pub fn listing(program: &Command) -> Value {
    let code = |(code, meaning): (u8, &str)| json!({ "code": code, "meaning": meaning });
    json!({
        "program": program.get_name(),
        "version": env!("CARGO_PKG_VERSION"),
        "exit_codes": code::MEANINGS.map(code),
        "arguments": arguments(program),
        "commands": commands(program),
    })
}

fn commands(of: &Command) -> Vec<Value> {
    let shown = of.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help");
    shown
        .map(|c| {
            json!({
                "name": c.get_name(),
                "about": c.get_about().map(ToString::to_string),
                "arguments": arguments(c),
                "commands": commands(c),
            })
        })
        .collect()
}

fn arguments(of: &Command) -> Vec<Value> {
    let shown = |a: &&Arg| !a.is_hide_set() && !["help", "version"].contains(&a.get_id().as_str());
    of.get_arguments().filter(shown).map(argument).collect()
}

fn argument(arg: &Arg) -> Value {
    let takes_value = arg.get_action().takes_values();
    let mut map = Map::new();
    map.insert("name".into(), arg.get_id().as_str().into());
    let mut insert = |key: &str, value: Option<Value>| {
        if let Some(value) = value {
            map.insert(key.into(), value);
        }
    };
    insert("flag", arg.get_long().map(|l| format!("--{l}").into()));
    let aliases: Vec<String> =
        arg.get_all_aliases().unwrap_or_default().iter().map(|a| format!("--{a}")).collect();
    insert("aliases", (!aliases.is_empty()).then(|| aliases.into()));
    insert("short", arg.get_short().map(|s| format!("-{s}").into()));
    let value = arg.get_value_names().and_then(<[_]>::first).filter(|_| takes_value);
    insert("value", value.map(|v| v.as_str().into()));
    insert("help", arg.get_help().map(|h| h.to_string().into()));
    insert("heading", arg.get_help_heading().map(Into::into));
    let default: Vec<String> =
        arg.get_default_values().iter().map(|v| v.to_string_lossy().into_owned()).collect();
    insert("default", (takes_value && !default.is_empty()).then(|| default.join(",").into()));
    let values: Vec<String> = arg.get_possible_values().iter().map(|v| v.get_name().to_owned()).collect();
    insert("values", (takes_value && !values.is_empty()).then(|| values.into()));
    insert("takes_value", Some(takes_value.into()));
    insert("required", Some(arg.is_required_set().into()));
    insert("repeatable", Some(matches!(arg.get_action(), ArgAction::Append).into()));
    Value::Object(map)
}
