//! Numbers and texts of attributes, and of small datasets, of any number type.

use hdf5_reader::{Dataset, Datatype};
use supervol_format::voxel_type::Voxel;
use supervol_format::with_voxel;

use super::number_of;
use crate::formats::cf::{Attribute, COORDINATES_LIMIT, Coordinates};
use crate::grid::elements::Number;

/// Attributes of programs that write netCDF files.
const OF_NETCDF: [&str; 3] = ["_Netcdf4Dimid", "_Netcdf4Coordinates", "DIMENSION_LIST"];
/// Fill values of netCDF for variables without one: floats, and integers of 16, 32 and 64 bits.
const NETCDF_FILLS: [f64; 7] = [
    9.969_209_968_386_869e36,
    -32_767.0,
    65_535.0,
    -2_147_483_647.0,
    4_294_967_295.0,
    -9_223_372_036_854_775_806.0,
    18_446_744_073_709_551_614.0,
];

/// An attribute of a dataset; `None` if there is none, or if it is neither numbers nor text.
pub(super) fn attribute(dataset: &Dataset, name: &str) -> Option<Attribute> {
    of(&dataset.attribute(name).ok()?)
}

/// Value of an attribute.
pub(super) fn of(attribute: &hdf5_reader::Attribute) -> Option<Attribute> {
    let is_float = matches!(attribute.datatype, Datatype::FloatingPoint { .. });
    let numbers = match number_of(&attribute.datatype) {
        None => return attribute.read_string().ok().map(Attribute::Text),
        Some(Number::Voxel(voxel_type)) => {
            with_voxel!(voxel_type, V => attribute.read_1d::<V>().ok()?.into_iter().map(Voxel::to_f64).collect())
        }
        Some(Number::Whole { signed: true }) => {
            attribute.read_1d::<i64>().ok()?.into_iter().map(|number| number as f64).collect()
        }
        Some(_) => attribute.read_1d::<u64>().ok()?.into_iter().map(|number| number as f64).collect(),
    };
    Some(Attribute::Numbers { numbers, is_float })
}

/// Numbers of an attribute.
pub(super) fn numbers(dataset: &Dataset, name: &str) -> Option<Vec<f64>> {
    match attribute(dataset, name)? {
        Attribute::Numbers { numbers, .. } => Some(numbers),
        Attribute::Text(_) => None,
    }
}

/// All numbers of a small dataset, in C order.
pub(super) fn numbers_of(dataset: &Dataset) -> Option<Vec<f64>> {
    if dataset.num_elements().ok()? > COORDINATES_LIMIT || matches!(dataset.dtype(), Datatype::Enum { .. }) {
        return None;
    }
    Some(match number_of(dataset.dtype())? {
        Number::Voxel(voxel_type) => {
            with_voxel!(voxel_type, V => dataset.read_array::<V>().ok()?.into_iter().map(Voxel::to_f64).collect())
        }
        Number::Whole { signed: true } => {
            dataset.read_array::<i64>().ok()?.into_iter().map(|number| number as f64).collect()
        }
        _ => dataset.read_array::<u64>().ok()?.into_iter().map(|number| number as f64).collect(),
    })
}

/// Coordinates in a dataset.
pub(super) fn coordinates(dataset: &Dataset) -> Option<Coordinates> {
    Some(Coordinates::of(&numbers_of(dataset)?, &|name| attribute(dataset, name)))
}

/// Fill value of a netCDF variable that states none: the library's own, if the dataset is filled with it. Bytes have
/// none.
pub(super) fn fill_of_netcdf(dataset: &Dataset) -> Option<f64> {
    let is_of_netcdf = OF_NETCDF.iter().any(|name| dataset.attribute(name).is_ok());
    let fill = dataset.fill_value().filter(|_| is_of_netcdf)?.value.clone()?;
    let datatype = dataset.dtype().clone();
    let whole = hdf5_reader::Attribute {
        name: String::new(),
        datatype,
        shape: Vec::new(),
        raw_data: fill,
        decoded_strings: None,
    };
    let fill = match of(&whole)? {
        Attribute::Numbers { numbers, .. } => *numbers.first()?,
        Attribute::Text(_) => return None,
    };
    let is_known = |known: &&f64| **known == fill || (fill > 9.9e36 && (fill / **known - 1.0).abs() < 1e-6);
    NETCDF_FILLS.iter().any(|known| is_known(&known)).then_some(fill)
}
