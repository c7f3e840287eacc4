use supervol_format::{Dims, Geometry, ValueRange};

use glam::DVec3;

use super::*;
use crate::camera::Projection;
use crate::clip::solids::{Keep, Shape};
use crate::facts::{DataKind, Frame};

const FULL: &str = r#"{
  "camera": {"eye": [0, 0, -10], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y": 30.0},
  "image": {"width": 80, "height": 60, "background": [0.1, 0.2, 0.3]},
  "mode": "dvr",
  "transfer_function": {"unit_distance": 2.0, "points": [
    {"value": 0, "color": [0, 0, 0], "alpha": 0}, {"value": 1, "color": [1, 1, 1], "alpha": 0.5}]},
  "shading": {"ambient": 0.2, "lights": [{"direction": [0, 0, 2]}]},
  "gradient_opacity": [0.5, 3],
  "cut_normals": true,
  "slices": [{"normal": [0, 0, 3], "offset": 3, "opacity": 0.5, "interpolation": "cubic", "filter": {"kind": "median", "size": 2}, "labels": true,
    "colors": [{"value": 0, "color": [0, 0, 0]}, {"value": 1, "color": [1, 1, 1]}]}],
  "clip": {"box": [[0, 0, 0], [5, 5, 5]], "planes": [{"normal": [1, 0, 0], "offset": 2}],
    "solids": [{"keep": "outside", "sphere": {"center": [1, 2, 3], "radius": 4}}, {"box": {"center": [5, 5, 5], "edges": [2, 4, 6]}},
      {"cylinder": {"from": [0, 0, 1], "to": [0, 0, 9], "radius": 2}}]},
  "vertical_exaggeration": 2.5,
  "samples_per_pixel": 4
}"#;

fn facts() -> VolumeFacts {
    VolumeFacts {
        percentiles: vec![(1.0, -4.0), (50.0, 0.0), (99.0, 4.5)],
        ..VolumeFacts::plain(
            Dims([100, 80, 60]),
            Geometry { spacing: [2.0, 1.0, 0.5], ..Geometry::IDENTITY },
            ValueRange { min: -5.0, max: 7.0 },
        )
    }
}

#[test]
fn a_full_scene_resolves() {
    let scene = Scene::from_json(FULL).unwrap().resolve(&facts()).unwrap();
    assert_eq!((scene.image_size, scene.subgrid), ([80, 60], 2));
    assert_eq!((scene.camera.width, scene.camera.height), (160, 120));
    assert_eq!(scene.transfer_function.unit_distance(), 2.0);
    let shading = scene.shading.unwrap();
    assert_eq!((shading.ambient, shading.diffuse), (0.2, 0.7));
    assert_eq!(shading.lights[0].to_light, DVec3::NEG_Z);
    assert_eq!(scene.gradient_opacity, Some(GradientOpacity { from: 0.5, to: 3.0 }));
    assert_eq!(scene.cut_normals.unwrap().box_cuts, [[true; 2]; 3]);
    assert_eq!(scene.clip.planes[0].offset, 2.0);
    let [ball, cuboid, drum] = &scene.clip.solids[..] else { panic!("three solids") };
    assert_eq!((ball.keep, cuboid.keep), (Keep::Outside, Keep::Inside));
    assert_eq!(ball.shape, Shape::Sphere { center: DVec3::new(1.0, 2.0, 3.0), radius: 4.0 });
    let (center, half_edges) = (DVec3::splat(5.0), [1.0, 2.0, 3.0]);
    assert_eq!(cuboid.shape, Shape::Cuboid { center, axes: DVec3::AXES, half_edges });
    assert_eq!(drum.shape, Shape::Cylinder { from: DVec3::Z, axis: DVec3::Z, length: 8.0, radius: 2.0 });
}

#[test]
fn paths_of_a_scene_begin_at_its_folder() {
    let mut scene = Scene::from_json(r#"{"clip": {"solids": [{"mesh": "a.ply"}, {"mesh": "/b.ply"}]}}"#).unwrap();
    scene.make_paths_relative_to(std::path::Path::new("/scenes"));
    let files: Vec<_> = scene.files().map(|file| file.display().to_string()).collect();
    assert_eq!(files, ["/scenes/a.ply", "/b.ply"]);
    assert_eq!(Scene::from_json(&serde_json::to_string(&scene).unwrap()).unwrap(), scene);
}

#[test]
fn what_is_left_out_has_the_models_defaults() {
    let scene = Scene::from_json(r#"{"shading": {}}"#).unwrap();
    assert_eq!((scene.image.width, scene.image.height, scene.mode), (800, 600, None));
    let resolved = scene.resolve(&facts()).unwrap();
    assert_eq!(resolved.mode, Mode::Dvr);
    assert_eq!(resolved.shading.unwrap().lights, [Light { to_light: -resolved.camera.forward, intensity: 1.0 }]);
    let points = r#"{"transfer_function": {"points": [{"value": 0, "color": [0, 0, 0], "alpha": 0}]}}"#;
    let resolved = Scene::from_json(points).unwrap().resolve(&facts()).unwrap();
    assert_eq!(resolved.transfer_function.unit_distance(), 0.5);
    assert!(resolved.shading.is_none());
}

#[test]
fn mistakes_are_named_with_their_place() {
    let message = |from: &str, to: &str| {
        assert!(FULL.contains(from), "{from} is not in the scene");
        Scene::from_json(&FULL.replace(from, to)).unwrap_err().to_string()
    };
    let unknown = message("\"ambient\"", "\"ambience\"");
    assert!(unknown.contains("`ambience`") && unknown.contains("line 7"), "{unknown}");
    let unknown = message("\"unit_distance\"", "\"distance\"");
    assert!(unknown.contains("`distance`") && unknown.contains("line 5"), "{unknown}");
    assert!(message("\"dvr\"", "\"vdr\"").contains("`vdr`"));
    assert!(message("\"vertical_exaggeration\": 2.5", "\"vertical_exaggeration\": 0").contains("found 0"));
    assert!(message("\"cubic\"", "\"quintic\"").contains("`quintic`"));
    assert!(message("\"dvr\"", "\"iso\"").contains("at least one surface"));
    assert!(message("\"fov_y\": 30.0", "\"fov_y\": 180").contains("found 180"));
    assert!(message("\"fov_y\": 30.0", "\"fov_y\": 30, \"height\": 2").contains("found both"));
    assert!(message(", \"fov_y\": 30.0", "").contains("found neither"));
    assert!(message("\"eye\": [0, 0, -10]", "\"eye\": [0, 0, 0]").contains("different points"));
    assert!(message("\"up\": [0, 1, 0]", "\"up\": [0, 0, 1]").contains("parallel"));
    assert!(message("\"width\": 80", "\"width\": 0").contains("image.width"));
    assert!(message("\"width\": 80", "\"width\": 4000000000").contains("at most"));
    assert!(message("\"samples_per_pixel\": 4", "\"samples_per_pixel\": 5").contains("found 5"));
    assert!(message("\"value\": 1,", "\"value\": -1,").contains("points[1]"));
    assert!(message("\"alpha\": 0.5", "\"alpha\": 1.5").contains("1.5"));
    assert!(message("\"unit_distance\": 2.0", "\"unit_distance\": 0").contains("unit_distance"));
    assert!(message("[5, 5, 5]", "[5, -5, 5]").contains("clip.box"));
    assert!(message("[0, 0, 2]", "[0, 0, 0]").contains("lights[0].direction"));
    assert!(message("\"radius\": 4", "\"radius\": -4").contains("clip.solids[0].sphere.radius"));
    assert!(message("\"keep\": \"outside\"", "\"mesh\": \"a.ply\"").contains("found several"));
    assert!(
        message("\"sphere\": {\"center\": [1, 2, 3], \"radius\": 4}", "\"keep\": \"inside\"").contains("duplicate")
    );
    assert!(message("{\"keep\": \"outside\"", "{}, {\"keep\": \"outside\"").contains("clip.solids[0]"));
    let skew = "\"edges\": [2, 4, 6], \"axes\": [[1, 0, 0], [1, 1, 0], [0, 0, 1]]";
    assert!(message("\"edges\": [2, 4, 6]", skew).contains("right angles"));
    assert!(message("\"to\": [0, 0, 9]", "\"to\": [0, 0, 1]").contains("two different ends"));
    assert!(
        message("\"mode\": \"dvr\",", "\"mode\": \"mip\", \"iso\": [{\"value\": 1, \"color\": [1, 1, 1]}],")
            .contains("no surfaces in this mode")
    );
}

#[test]
fn opacity_by_the_gradient_is_a_ramp_of_mode_dvr() {
    let read = |json: &str| Scene::from_json(json).and_then(|scene| scene.resolve(&facts()));
    let refused = |json: &str| read(json).unwrap_err().to_string();
    for ends in ["[-1, 2]", "[2, 2]", "[3, 2]", "[0, 0]", "[1, 1.0000005]"] {
        let message = refused(&format!(r#"{{"gradient_opacity": {ends}}}"#));
        assert!(message.contains("`gradient_opacity`") && message.contains("0 <= G0 < G1"), "{message}");
    }
    assert!(refused(r#"{"gradient_opacity": [0, 1e200]}"#).contains("gradient_opacity"));
    assert!(refused(r#"{"gradient_opacity": [1]}"#).contains("length 1"));
    for mode in ["mip", "minip", "mean"] {
        let message = refused(&format!(r#"{{"gradient_opacity": [0, 1], "mode": "{mode}"}}"#));
        assert!(message.contains("mode `dvr`") && message.contains(&format!("found mode `{mode}`")), "{message}");
    }
    // Only a volume has it: kinds with another default picture show theirs as a volume.
    for kind in DataKind::ALL {
        let scene = Scene::from_json(r#"{"gradient_opacity": [0, 1]}"#).unwrap();
        let facts = VolumeFacts { kind, ..facts() };
        assert_eq!(scene.resolve(&facts).unwrap().mode, Mode::Dvr, "{kind:?}");
        let complete = scene.complete(&facts, None);
        assert_eq!(complete.resolve(&facts).unwrap(), scene.resolve(&facts).unwrap(), "{kind:?}");
    }
    let ramp = GradientOpacity { from: 1.0, to: 3.0 };
    assert_eq!([0.5, 1.0, 2.0, 3.0, 9.0].map(|length| ramp.factor(length)), [0.0, 0.0, 0.5, 1.0, 1.0]);
    // The picture of a volume with extreme numbers is computed in other units.
    let geometry = Geometry { spacing: [1e-30; 3], ..Geometry::IDENTITY };
    let facts = VolumeFacts { geometry, ..facts() };
    let scene = Scene { gradient_opacity: Some([1e30, 2e30]), mode: Some(Mode::Dvr), ..Scene::default() };
    let (found, units) = (scene.resolve(&facts).unwrap().gradient_opacity.unwrap(), Units::of(&facts));
    assert_eq!(found.from, 1e30 * units.length / units.value);
    assert!(found.from > 0.1 && found.from < 10.0, "{found:?}");
}

#[test]
fn cut_normals_need_mode_dvr_a_cut_and_light() {
    let read = |json: &str| Scene::from_json(json).and_then(|scene| scene.resolve(&facts()));
    let refused = |json: &str| read(json).unwrap_err().to_string();
    let clip = r#""clip": {"planes": [{"normal": [1, 0, 0], "offset": 3}]}"#;
    for (mode, more) in
        [("mip", ""), ("minip", ""), ("mean", ""), ("iso", r#", "iso": [{"value": 1, "color": [1, 1, 1]}]"#)]
    {
        let message = refused(&format!(r#"{{"cut_normals": true, "mode": "{mode}"{more}, {clip}}}"#));
        assert!(message.contains("`cut_normals`") && message.contains(&format!("found mode `{mode}`")), "{message}");
    }
    let message = refused(r#"{"cut_normals": true, "mode": "dvr"}"#);
    assert!(message.contains("`cut_normals`") && message.contains("found no cut"), "{message}");
    let message = refused(&format!(r#"{{"cut_normals": true, "shading": null, {clip}}}"#));
    assert!(message.contains("`cut_normals`") && message.contains("found no shading"), "{message}");
    // They bring the default light, and a volume for kinds with another default picture.
    for kind in DataKind::ALL {
        let scene = Scene::from_json(&format!(r#"{{"cut_normals": true, {clip}}}"#)).unwrap();
        let facts = VolumeFacts { kind, ..facts() };
        let resolved = scene.resolve(&facts).unwrap();
        assert!(resolved.mode == Mode::Dvr && resolved.shading.is_some(), "{kind:?}");
        assert_eq!(resolved.cut_normals.as_ref().unwrap().clip, resolved.clip, "{kind:?}");
        assert_eq!(scene.complete(&facts, None).resolve(&facts).unwrap(), resolved, "{kind:?}");
    }
    // Lengths behind a face are in the units of the picture, by the smallest spacing.
    let geometry = Geometry { spacing: [2.0, 0.5, 1.0], ..Geometry::IDENTITY };
    let scene = Scene::from_json(&format!(r#"{{"cut_normals": true, {clip}}}"#)).unwrap();
    let found = scene.resolve(&VolumeFacts { geometry, ..facts() }).unwrap().cut_normals.unwrap();
    assert_eq!(found.depths, [1.0, 2.0]);
    assert!(read(&format!(r#"{{"cut_normals": false, {clip}}}"#)).unwrap().cut_normals.is_none());
}

#[test]
fn presets_are_known_by_name() {
    for name in preset::NAMES {
        assert!(name == "grey" || name.parse::<DataKind>().is_ok(), "{name}");
        let text = format!(r#"{{"transfer_function": "{name}"}}"#);
        let scene = Scene::from_json(&text).unwrap().resolve(&facts()).unwrap();
        assert!(scene.transfer_function.points().len() > 1);
    }
    let error = Scene::from_json(r#"{"transfer_function": "gray"}"#).unwrap_err().to_string();
    assert!(error.contains("gray") && error.contains("seismic"), "{error}");
    let error = Scene::from_json(r#"{"transfer_function": 3}"#).unwrap_err().to_string();
    assert!(error.contains("preset") && error.contains("line 1"), "{error}");
}

#[test]
fn the_default_camera_sees_the_whole_volume() {
    for kind in [DataKind::Generic, DataKind::Seismic, DataKind::Ct] {
        let frame = if kind.is_seismic() { Frame::Survey } else { Frame::Unknown };
        let facts = VolumeFacts { kind, frame, ..facts() };
        let camera = Scene::default().resolve(&facts).unwrap().camera;
        let slope = 15f64.to_radians().tan();
        let mut greatest: f64 = 0.0;
        for corner in preset::domain_corners(&facts) {
            let p = corner - camera.eye;
            let depth = p.dot(camera.forward);
            let across = p.dot(camera.right) / (depth * slope * 800.0 / 600.0);
            let along = p.dot(camera.up) / (depth * slope);
            greatest = greatest.max(across.abs()).max(along.abs());
        }
        assert!(greatest < 1.0 && greatest > 0.8, "{kind:?}: {greatest}");
        if kind == DataKind::Seismic {
            assert!(camera.up.z < 0.0, "the sample axis points down");
        }
    }
}

#[test]
fn an_empty_scene_is_the_default_picture_and_a_complete_one_means_the_same() {
    for kind in DataKind::ALL {
        let mut facts = VolumeFacts { kind, ..facts() };
        for dims in [[100, 80, 60], [1, 80, 60], [1, 1, 60]] {
            facts.dims = Dims(dims);
            let empty = Scene::from_json("{}").unwrap();
            let complete = empty.complete(&facts, None);
            assert_eq!(empty.resolve(&facts).unwrap(), complete.resolve(&facts).unwrap(), "{kind:?}");
            assert_eq!(complete.complete(&facts, None), complete, "{kind:?}: nothing is left open");
            let text = serde_json::to_string(&complete).unwrap();
            assert_eq!(Scene::from_json(&text).unwrap(), complete, "{kind:?}: what is written can be read");
        }
    }
}

#[test]
fn kinds_have_the_looks_that_their_users_know() {
    let look = |kind| Scene::default().resolve(&VolumeFacts { kind, ..facts() }).unwrap();
    assert_eq!((look(DataKind::Fluorescence).mode, look(DataKind::Mask).mode), (Mode::Mip, Mode::Iso));
    assert!(look(DataKind::Ct).shading.is_some() && look(DataKind::Seismic).shading.is_none());
    assert_eq!(look(DataKind::Mask).iso[0].value, 1.0);
    // Amplitudes: symmetric around zero, and transparent at zero.
    let amplitudes = look(DataKind::Seismic).transfer_function;
    let [first, last] = [0, amplitudes.points().len() - 1].map(|i| amplitudes.points()[i].value);
    assert_eq!((first, last, amplitudes.classify(0.0).1), (-4.5, 4.5, 0.0));
    // A section is opaque, seen face on, with several rays per pixel.
    let section = VolumeFacts { kind: DataKind::Seismic, dims: Dims([100, 1, 60]), ..facts() };
    let section = Scene::default().resolve(&section).unwrap();
    assert!(matches!(section.camera.projection, Projection::Orthographic { .. }) && section.subgrid == 4);
    assert!(section.transfer_function.points().iter().all(|p| p.alpha == 1.0));
}

/// A microscope's background is noise. Mode `dvr` must show the bright parts, not the noise on the volume's faces.
#[test]
fn fluorescence_as_a_body_is_clear_where_it_is_dark() {
    let facts = VolumeFacts { kind: DataKind::Fluorescence, ..facts() };
    let body = Scene { mode: Some(Mode::Dvr), ..Scene::default() }.resolve(&facts).unwrap().transfer_function;
    let [first, last] = [body.points().first(), body.points().last()].map(|p| p.expect("points").value);
    assert!(body.classify(first).1 == 0.0 && body.classify(last).1 > 0.5 && first > facts.value_range.min);
    let opaque = Scene::default().resolve(&facts).unwrap().transfer_function;
    assert!(opaque.points().iter().all(|p| p.alpha == 1.0), "the projection stays what it was");
}

#[test]
fn surfaces_are_lit_and_projections_have_grey_ramps_of_their_own() {
    let resolve = |json: &str| Scene::from_json(json).unwrap().resolve(&facts()).unwrap();
    assert!(resolve(r#"{"mode": "iso", "iso": [{"value": 1, "color": [1, 1, 1]}]}"#).shading.is_some());
    assert!(resolve(r#"{"shading": null, "iso": [{"value": 1, "color": [1, 1, 1]}]}"#).shading.is_none());
    assert_eq!(resolve(r#"{"iso": [{"value": 1, "color": [1, 1, 1]}]}"#).mode, Mode::Iso);
    let window = |mode: &str| {
        let shown = resolve(&format!(r#"{{"mode": "{mode}"}}"#));
        let points = shown.transfer_function.points().to_vec();
        assert!(points.iter().all(|p| p.alpha == 1.0) && points[0].color == [0.0; 3] && points[1].color == [1.0; 3]);
        [points[0].value, points[1].value]
    };
    let [mip, minip, mean] = ["mip", "minip", "mean"].map(window);
    assert!(mip[1] > mean[1] && mean[0] > minip[0] && minip[1] < mip[1], "{mip:?} {minip:?} {mean:?}");
}

/// Every key of a JSON value: `camera.eye`, `iso[].value`.
fn keys(value: &serde_json::Value, at: &str, found: &mut std::collections::BTreeSet<String>) {
    match value {
        serde_json::Value::Object(members) => {
            for (name, member) in members {
                let key = if at.is_empty() { name.clone() } else { format!("{at}.{name}") };
                found.insert(key.clone());
                keys(member, &key, found);
            }
        }
        serde_json::Value::Array(items) => items.iter().for_each(|item| keys(item, &format!("{at}[]"), found)),
        _ => {}
    }
}

#[test]
fn the_page_on_scenes_has_every_key_and_no_other() {
    let page = include_str!("../../../../docs/scene.md");
    let table = page.split("\n\n").find(|part| part.starts_with("| key |")).expect("the page has a table of keys");
    let named: std::collections::BTreeSet<String> =
        table.lines().skip(2).filter_map(|row| row.split('`').nth(1)).map(str::to_owned).collect();
    // A scene with every key, and both kinds of cameras.
    let full = FULL.replace("\"clip\"", "\"iso\": [{\"value\": 1, \"color\": [1, 1, 1]}], \"clip\"");
    let full = full.replace("\"solids\": [", "\"solids\": [{\"mesh\": \"hull.ply\"}, ");
    let mut known = std::collections::BTreeSet::new();
    for camera in ["\"fov_y\": 30.0", "\"height\": 30.0"] {
        let scene = Scene::from_json(&full.replace("\"fov_y\": 30.0", camera)).unwrap();
        keys(&serde_json::to_value(&scene).unwrap(), "", &mut known);
    }
    assert_eq!(named, known);
    for kind in DataKind::ALL {
        assert!(page.contains(&format!("`{}`", kind.name())), "{kind:?} is not on the page");
    }
    for name in preset::NAMES {
        assert!(page.contains(&format!("`{name}`")), "{name} is not on the page");
    }
}

/// `supervol schema > docs/scene.schema.json`
#[test]
fn the_schema_in_the_documents_is_that_of_the_types() {
    let page: serde_json::Value = serde_json::from_str(include_str!("../../../../docs/scene.schema.json")).unwrap();
    assert_eq!(page, Scene::schema(), "docs/scene.schema.json is older than the types");
    // The schema has exactly the keys of a scene and a description of each.
    let full: serde_json::Value = serde_json::from_str(FULL).unwrap();
    let known = page["properties"].as_object().unwrap();
    assert!(full.as_object().unwrap().keys().all(|key| known.contains_key(key)));
    assert_eq!(page["additionalProperties"], false);
    assert!(known.iter().all(|(_, of_key)| of_key["description"].is_string()), "{known:?}");
}

#[test]
fn what_f32_or_f64_cannot_hold_is_refused_by_name() {
    let refusal = |from: &str, to: &str| {
        assert!(FULL.contains(from), "{from} is not in the scene");
        let scene = Scene::from_json(&FULL.replace(from, to));
        scene.and_then(|scene| scene.resolve(&facts())).unwrap_err().to_string()
    };
    assert!(refusal("\"ambient\": 0.2", "\"ambient\": 1e30").contains("shading.ambient"));
    assert!(refusal("\"ambient\": 0.2", "\"shininess\": 1e30").contains("shading.shininess"));
    assert!(refusal("[0, 0, 2]", "[0, 0, 2], \"intensity\": 1e300").contains("lights[0].intensity"));
    assert!(refusal("[0, 0, -10]", "[0, 0, -1e18]").contains("camera.eye"));
    assert!(refusal("[0, 0, -10]", "[0, 0, -1.5e308]").contains("camera.eye"));
    assert!(refusal("\"fov_y\": 30.0", "\"height\": 1e-200").contains("camera.height"));
    assert!(refusal("\"fov_y\": 30.0", "\"height\": 1e200").contains("camera.height"));
    assert!(refusal("\"unit_distance\": 2.0", "\"unit_distance\": 1e-300").contains("unit_distance"));
    assert!(refusal("\"unit_distance\": 2.0", "\"unit_distance\": 1e300").contains("unit_distance"));
    let geometry = Geometry { spacing: [1.0, 1.0, 1e19], ..Geometry::IDENTITY };
    let flat = Scene::default().resolve(&VolumeFacts { geometry, ..facts() }).unwrap_err().to_string();
    assert!(flat.contains("spacing"), "{flat}");
}

#[test]
fn directions_of_any_length_mean_the_same() {
    let resolve = |light: &str, normal: &str, up: &str| {
        let text = FULL.replace("[0, 0, 2]", light).replace("\"normal\": [1, 0, 0], \"offset\": 2", normal);
        Scene::from_json(&text.replace("\"up\": [0, 1, 0]", up)).unwrap().resolve(&facts()).unwrap()
    };
    let plain = resolve("[0, 0, 2]", "\"normal\": [1, 0, 0], \"offset\": 2", "\"up\": [0, 1, 0]");
    let long = resolve("[0, 0, 1e300]", "\"normal\": [1e300, 0, 0], \"offset\": 2e300", "\"up\": [0, 1e300, 0]");
    let short = resolve("[0, 0, 1e-300]", "\"normal\": [1e-300, 0, 0], \"offset\": 2e-300", "\"up\": [0, 1e-300, 0]");
    for scene in [long, short] {
        assert_eq!(scene.camera, plain.camera);
        let light = |scene: &ResolvedScene| scene.shading.as_ref().unwrap().lights[0].to_light;
        assert!(light(&scene).distance(light(&plain)) < 1e-15, "{:?}", scene.shading);
        let plane = scene.clip.planes[0];
        assert!((plane.offset / plane.normal.x - 2.0).abs() < 1e-12, "{plane:?}");
    }
}
