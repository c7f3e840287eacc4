use supervol_format::container::manifest::{AxisName, Source};

use super::*;

/// A volume given by its histogram: bin i holds the voxels of value `min + i * step`.
#[derive(Clone)]
struct Made {
    counts: Vec<u64>,
    min: f64,
    step: f64,
    integral: bool,
    format: &'static str,
    name: &'static str,
    space: &'static str,
    modality: &'static str,
}

const PLAIN: Made = Made {
    counts: Vec::new(),
    min: 0.0,
    step: 1.0,
    integral: true,
    format: "raw",
    name: "a.raw",
    space: "",
    modality: "",
};

impl Made {
    fn kind(&self) -> DataKind {
        self.recognised().kind
    }

    fn recognised(&self) -> Recognised {
        let total: u64 = self.counts.iter().sum();
        let value = |bin: usize| self.min + bin as f64 * self.step;
        let percentile = |percent: f64| {
            let mut below = 0;
            let reached = |count: &u64| {
                below += count;
                below as f64 >= total as f64 * percent / 100.0
            };
            [percent, value(self.counts.iter().position(reached).unwrap_or(0))]
        };
        let percents = [0.1, 1.0, 2.0, 5.0, 25.0, 50.0, 75.0, 95.0, 98.0, 99.0, 99.9];
        let axis = || AxisName { name: String::new(), unit: String::new() };
        let manifest = Manifest {
            tool: String::new(),
            parameters: [("reader_modality", self.modality)]
                .into_iter()
                .filter(|(_, modality)| !modality.is_empty())
                .map(|(name, modality)| (name.to_string(), modality.to_string()))
                .collect(),
            source: Source { name: self.name.into(), format: self.format.into(), bytes: 0, xxh3_64: String::new() },
            space: self.space.into(),
            axes: [axis(), axis(), axis()],
            unit: String::new(),
            value_range: (total > 0).then(|| ValueRange { min: self.min, max: value(self.counts.len() - 1) }),
            present_voxels: total,
            histogram: self.counts.clone(),
            percentiles: percents.map(percentile).to_vec(),
            distribution: None,
            level_errors: vec![],
            survey: None,
            notes: vec![],
            others: Default::default(),
        };
        Evidence::new(&manifest, supervol_format::Dims([64; 3]), self.integral).recognise()
    }
}

/// Bell-shaped counts around the bin `middle`.
fn bell(bins: usize, middle: f64, width: f64, most: f64) -> Vec<u64> {
    (0..bins).map(|i| (most * (-((i as f64 - middle) / width).powi(2)).exp()) as u64).collect()
}

fn sum(a: &[u64], b: &[u64]) -> Vec<u64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

#[test]
fn seismic_files_hold_amplitudes_or_attributes() {
    let survey = |counts, min, step| Made { counts, min, step, integral: false, format: "segy", ..PLAIN };
    assert_eq!(survey(bell(256, 128.0, 20.0, 1e4), -12_800.0, 100.0).kind(), DataKind::Seismic);
    assert_eq!(survey(bell(256, 100.0, 40.0, 1e4), 1500.0, 12.0).kind(), DataKind::SeismicAttribute);
    // Values of one sign, except for a little noise.
    assert_eq!(survey(bell(256, 100.0, 60.0, 1e4), -10.0, 1.0).kind(), DataKind::SeismicAttribute);
    // Bytes around 128: amplitudes stored unsigned.
    let bytes = Made { counts: bell(256, 127.0, 20.0, 1e4), format: "segy", ..PLAIN };
    assert_eq!(bytes.kind(), DataKind::Seismic);
    let synthetic =
        Made { format: "synth", name: "seismic seed 1", ..survey(bell(256, 128.0, 20.0, 1e4), -1.0, 1.0 / 128.0) };
    assert_eq!(synthetic.kind(), DataKind::Seismic);
}

#[test]
fn tomography_is_recognised_by_air_and_by_soft_tissue() {
    let body = sum(&bell(256, 10.0, 3.0, 3e4), &bell(256, 78.0, 3.0, 2e4));
    let hounsfield = Made { counts: body.clone(), min: -1180.0, step: 16.0, ..PLAIN };
    assert_eq!(hounsfield.kind(), DataKind::Ct);
    // The same with 1024 added and nothing below zero.
    let unsigned =
        Made { counts: sum(&bell(256, 2.0, 3.0, 3e4), &bell(256, 66.0, 3.0, 2e4)), min: 0.0, step: 16.0, ..PLAIN };
    assert_eq!(unsigned.kind(), DataKind::CtOffset);
    // Wide amplitudes in a file whose format is not seismic: no air peak.
    let signed = Made { counts: bell(256, 128.0, 12.0, 1e4), min: -2560.0, step: 20.0, ..PLAIN };
    assert_eq!(signed.kind(), DataKind::Generic);
}

#[test]
fn patients_without_hounsfield_units_are_magnetic_resonance_unless_the_name_says_ct() {
    let counts = sum(&bell(256, 5.0, 5.0, 4e4), &bell(256, 120.0, 30.0, 2e3));
    let patient = Made { counts, space: "right-anterior-superior", format: "nifti", name: "head.nii.gz", ..PLAIN };
    assert_eq!(patient.kind(), DataKind::Mri);
    assert_eq!(Made { name: "carp_ct.nii.gz", ..patient }.kind(), DataKind::Ct);
}

#[test]
fn images_are_told_apart_by_how_bright_they_are() {
    let mut few_bright = bell(256, 4.0, 4.0, 1e5);
    (100..256).for_each(|bin| few_bright[bin] += 10);
    assert_eq!(Made { counts: few_bright.clone(), format: "tiff", ..PLAIN }.kind(), DataKind::Fluorescence);
    // A file of no microscope may as well be a simulation.
    assert_eq!(Made { counts: few_bright, ..PLAIN }.kind(), DataKind::Generic);
    assert_eq!(Made { counts: bell(256, 120.0, 50.0, 1e4), ..PLAIN }.kind(), DataKind::ElectronMicroscopy);
    let solid = sum(&bell(256, 5.0, 5.0, 1e5), &bell(256, 180.0, 20.0, 1e4));
    assert_eq!(Made { counts: solid.clone(), ..PLAIN }.kind(), DataKind::MicroCt);
    // The same in a file with other channels: fluorescence instead of solid matter.
    let channel = Made { counts: solid, name: "cells.ome.tif --channel 1", ..PLAIN };
    assert_eq!(channel.kind(), DataKind::Fluorescence);
    let field = Made { counts: bell(256, 120.0, 50.0, 1e4), integral: false, ..PLAIN };
    assert_eq!(field.kind(), DataKind::Generic);
}

#[test]
fn solid_matter_has_a_peak_of_its_own_and_fading_fields_have_none() {
    // A tooth in noisy air: dentine and enamel.
    let tooth = sum(&sum(&bell(256, 30.0, 9.0, 4e4), &bell(256, 140.0, 14.0, 9e3)), &bell(256, 205.0, 12.0, 5e3));
    assert_eq!(Made { counts: tooth, ..PLAIN }.kind(), DataKind::MicroCt);
    let fading: Vec<u64> = (0..256).map(|i| (1e6 * (-f64::from(i) / 12.0).exp()) as u64 + 20).collect();
    let field = Made { counts: fading, ..PLAIN }.recognised();
    assert_eq!((field.kind, field.certainty), (DataKind::Generic, Certainty::Guess));
    // Equally frequent values are no tissue, and a few voxels tell nothing.
    assert_eq!(Made { counts: vec![500; 256], ..PLAIN }.kind(), DataKind::Generic);
    assert_eq!(Made { counts: bell(256, 120.0, 50.0, 10.0), ..PLAIN }.kind(), DataKind::Generic);
}

#[test]
fn modalities_and_names_say_more_than_values() {
    let counts = sum(&bell(256, 5.0, 5.0, 4e4), &bell(256, 120.0, 30.0, 2e3));
    let plain = Made { counts, ..PLAIN };
    assert_eq!(Made { name: "HeadMRVolume.mhd", ..plain.clone() }.kind(), DataKind::Mri);
    assert_eq!(Made { name: "sub-01_T1w.nii", ..plain.clone() }.kind(), DataKind::Mri);
    assert_eq!(Made { name: "tmr2.raw", ..plain.clone() }.kind(), DataKind::MicroCt);
    let dicom = |modality| Made { modality, format: "dicom", space: "left-posterior-superior", ..plain.clone() };
    let recognised = dicom("MR").recognised();
    assert_eq!((recognised.kind, recognised.certainty), (DataKind::Mri, Certainty::Certain));
    assert_eq!(dicom("RTDOSE").kind(), DataKind::Generic);
    assert_eq!(dicom("").kind(), DataKind::Mri);
}

#[test]
fn few_values_are_labels_or_a_mask_and_one_is_nothing() {
    let mut counts = vec![0; 256];
    (counts[0], counts[255]) = (900, 100);
    assert_eq!(Made { counts: counts.clone(), ..PLAIN }.kind(), DataKind::Mask);
    counts[40] = 500;
    counts[90] = 500;
    assert_eq!(Made { counts: counts.clone(), ..PLAIN }.kind(), DataKind::Labels);
    assert_ne!(Made { counts, integral: false, ..PLAIN }.kind(), DataKind::Labels);
    // A few dozen voxels are too few for labels, even with few different values.
    assert_ne!(Made { counts: vec![1; 27], ..PLAIN }.kind(), DataKind::Labels);
    assert_eq!(Made { counts: vec![7], min: 3.0, ..PLAIN }.kind(), DataKind::Constant);
    assert_eq!(PLAIN.kind(), DataKind::Empty);
}

#[test]
fn names_are_kinds_and_back() {
    for kind in DataKind::ALL {
        assert_eq!(kind.name().parse(), Ok(kind));
    }
    assert!("jpeg".parse::<DataKind>().is_err_and(|e| e.contains("seismic") && e.contains("jpeg")));
}
