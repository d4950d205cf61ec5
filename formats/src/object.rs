//! JSON objects as maps.

/// A JSON object to which fields can be added: `object! { "key": value, … }`. A key is a literal or a variable, a value any expression that
/// can be serialized, so `json!({ … })` for an object.
#[macro_export]
macro_rules! object {
    ($($key:tt : $value:expr),* $(,)?) => {
        serde_json::Map::from_iter([$((String::from($key), serde_json::json!($value))),*])
    };
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    #[test]
    fn object_is_that_of_json() {
        let (key, owned) = ("b", String::from("text"));
        let map = object! { "z": 1, key: json!({ "y": owned, "x": 2 }), "a": [1, 2], "none": None::<u8> };
        let expected = json!({ "z": 1, (key): { "y": owned, "x": 2 }, "a": [1, 2], "none": null });
        assert_eq!(Value::Object(map).to_string(), expected.to_string());
    }
}
