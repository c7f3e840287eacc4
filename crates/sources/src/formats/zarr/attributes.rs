//! Attributes of an array as those of the CF conventions.

use serde_json::Value;

use crate::formats::cf::{Attribute, Explanation};

/// Meaning of the stored numbers of an array with these attributes.
pub(super) fn explanation(attributes: &Value) -> Explanation {
    Explanation::of(&|name| attribute(&attributes[name]).or_else(|| of_mdio(attributes, name)))
}

/// An attribute of numbers or of text.
pub(super) fn attribute(value: &Value) -> Option<Attribute> {
    let of_numbers = |values: &[Value]| {
        // Words for NaN and infinities have become strings.
        let number = |value: &Value| value.as_f64().or_else(|| value.as_str()?.parse().ok());
        let numbers: Option<Vec<f64>> = values.iter().map(number).collect();
        Some(Attribute::Numbers { numbers: numbers?, is_float: values.iter().any(Value::is_f64) })
    };
    match value {
        Value::String(text) => Some(Attribute::Text(text.clone())),
        Value::Number(_) => of_numbers(std::slice::from_ref(value)),
        Value::Array(values) => of_numbers(values),
        _ => None,
    }
}

/// The unit of an array by MDIO: `unitsV1` names the quantity and its unit.
pub(super) fn of_mdio(attributes: &Value, name: &str) -> Option<Attribute> {
    let quantities = attributes["unitsV1"].as_object().filter(|_| name == "units")?;
    quantities.values().next()?.as_str().map(|unit| Attribute::Text(unit.into()))
}

/// Adds the fill value of version 2 to the attributes of an array by xarray, for which it is the absent value. 0 is
/// ignored: other programs write it for arrays without absent values.
pub(super) fn add_fill_of_xarray(attributes: &mut Value, fill: &Value) {
    let is_of_xarray = attributes.get("_ARRAY_DIMENSIONS").is_some() && attributes.get("multiscales").is_none();
    let is_fill = fill.as_f64().is_some_and(|fill| fill != 0.0);
    if is_of_xarray && is_fill && attributes.get("_FillValue").is_none() {
        attributes["_FillValue"] = fill.clone();
    }
}
