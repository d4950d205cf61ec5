//! Values of a recipe: one, several, or a range of numbers.

use std::fmt;

use serde::de::{Error, MapAccess, SeqAccess, Visitor, value};
use serde::{Deserialize, Deserializer, Serialize};

/// Numbers that a field of a sample may have.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Numbers {
    /// One of these.
    List(Vec<f64>),
    /// Any between two.
    Range(Range),
}

/// A range of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// The least.
    pub from: f64,
    /// The largest.
    pub to: f64,
    /// Whether the logarithm is drawn uniformly rather than the number.
    #[serde(default)]
    pub log: bool,
}

impl Range {
    /// The number at the share `u` of the range.
    pub fn at(self, u: f64) -> f64 {
        match self.log {
            true => self.from * pipeline::real::pow(self.to / self.from, u),
            false => self.from + u * (self.to - self.from),
        }
    }

    /// The number at the share `u` of the area between two radii.
    pub fn radius_at(self, u: f64) -> f64 {
        let squares = [self.from * self.from, self.to * self.to];
        (squares[0] + u * (squares[1] - squares[0])).sqrt()
    }
}

impl Numbers {
    /// Fails unless all are within `bounds` and a range ascends.
    ///
    /// # Errors
    /// What is wrong.
    pub fn check(&self, field: &str, (least, largest): (f64, f64)) -> Result<(), String> {
        let inside = |v: f64| v >= least && v <= largest;
        match self {
            Self::List(values) if values.is_empty() => Err(format!("{field}: expected one or more numbers")),
            Self::List(values) => match values.iter().find(|v| !inside(**v)) {
                None => Ok(()),
                Some(v) => Err(format!("{field}: expected {least} to {largest}, found {v}")),
            },
            Self::Range(Range { from, to, log }) => {
                if !(inside(*from) && inside(*to) && from <= to && to.is_finite()) {
                    return Err(format!(
                        "{field}: expected {least} <= from <= to <= {largest}, found from {from}, to {to}"
                    ));
                }
                match *log && *from <= 0.0 {
                    true => Err(format!("{field}: a logarithmic range begins above 0, found {from}")),
                    false => Ok(()),
                }
            }
        }
    }
}

impl<'de> Deserialize<'de> for Numbers {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Numbers;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, a list of numbers, or { from = A, to = B }")
            }

            fn visit_f64<E: Error>(self, v: f64) -> Result<Numbers, E> {
                Ok(Numbers::List(vec![v]))
            }

            fn visit_i64<E: Error>(self, v: i64) -> Result<Numbers, E> {
                Ok(Numbers::List(vec![v as f64]))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Numbers, A::Error> {
                Vec::deserialize(value::SeqAccessDeserializer::new(seq)).map(Numbers::List)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Numbers, A::Error> {
                Range::deserialize(value::MapAccessDeserializer::new(map)).map(Numbers::Range)
            }
        }
        deserializer.deserialize_any(Any)
    }
}

/// One text or several.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Texts(pub Vec<String>);

impl<'de> Deserialize<'de> for Texts {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Texts;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a text or a list of texts")
            }

            fn visit_str<E: Error>(self, v: &str) -> Result<Texts, E> {
                Ok(Texts(vec![v.to_owned()]))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Texts, A::Error> {
                Vec::deserialize(value::SeqAccessDeserializer::new(seq)).map(Texts)
            }
        }
        deserializer.deserialize_any(Any)
    }
}
