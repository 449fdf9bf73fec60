use glam::dvec3;

use super::*;

fn scene(instances: &str) -> Result<SceneFile> {
    let text = format!(
        r#"{{"inputs": {{"a": "a.ply", "b": "scene:torus:99", "again": "a.ply", "unused": "/u.ply"}}, "instances": {instances}}}"#
    );
    parse(&text, Path::new("folder"))
}

#[test]
fn instances_are_put_where_they_are_meant() {
    let s = scene(
        r#"[{"of": "b", "translate": [1, 2, 3], "rotate": {"axis": [0, 0, 7], "degrees": 450}, "scale": 2},
            {"of": "again"}, {"of": "a", "translate": [9, 0, 0], "grid": {"count": [2, 1, 3], "step": [10, 5, -1]}}]"#,
    )
    .unwrap();
    // One input by two names is one cloud; what is not drawn is not read.
    let torus = Input::Scene { name: "torus".into(), points: 99, seed: 1 };
    assert_eq!(s.inputs, [torus, Input::File("folder/a.ply".into())]);
    assert_eq!(s.names, ["b", "again"]);
    assert_eq!(s.instances.iter().map(|i| i.cloud).collect::<Vec<_>>(), [0, 1, 1, 1, 1, 1, 1, 1]);
    // Scaled, turned a quarter about z, moved.
    let p = s.instances[0].transform.transform_point3(DVec3::X);
    assert!((p - dvec3(1.0, 4.0, 3.0)).length() < 1e-12, "{p}");
    assert_eq!(s.instances[1].transform, DMat4::IDENTITY);
    let places: Vec<DVec3> = s.instances[2..].iter().map(|i| i.transform.transform_point3(DVec3::ZERO)).collect();
    let x = [9.0, 19.0];
    let expected: Vec<DVec3> = [0.0, -1.0, -2.0].iter().flat_map(|&z| x.map(|x| dvec3(x, 0.0, z))).collect();
    assert_eq!(places, expected);
    assert_eq!(
        scene(r#"[{"of": "a", "grid": {"count": [1000, 1000, 1], "step": [0, 0, 0]}}]"#).unwrap().instances.len(),
        MAX_INSTANCES
    );
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    for (instances, says) in [
        ("[]", "instances: a list with at least one"),
        ("{}", "instances: a list"),
        ("[7]", "instances[0]: an object"),
        ("[{}]", "instances[0].of: is missing"),
        (r#"[{"of": "a"}, {"of": "c"}]"#, "instances[1].of: there is no input \"c\""),
        (r#"[{"of": 1}]"#, "instances[0].of: there is no input 1"),
        (r#"[{"of": "a", "size": 1}]"#, "instances[0].size: unknown"),
        (r#"[{"of": "a"}, {"of": "a"}, {"of": "a", "scale": 0}]"#, "instances[2].scale: must be more than 0"),
        (r#"[{"of": "a", "scale": -1}]"#, "scale: must be more than 0"),
        (r#"[{"of": "a", "scale": 1e-40}]"#, "scale: must be at least"),
        (r#"[{"of": "a", "scale": 1e40}]"#, "scale: a number of at most"),
        (r#"[{"of": "a", "scale": [1, 2, 1]}]"#, "scale: a number"),
        (r#"[{"of": "a", "scale": null}]"#, "scale: a number"),
        (r#"[{"of": "a", "translate": [1, 2]}]"#, "translate: three numbers"),
        (r#"[{"of": "a", "translate": [1, "2", 3]}]"#, "translate[1]: a number"),
        (r#"[{"of": "a", "rotate": {"axis": [0, 0, 0], "degrees": 1}}]"#, "rotate.axis: must not be of length zero"),
        (r#"[{"of": "a", "rotate": {"axis": [0, 0, 1]}}]"#, "rotate.degrees: is missing"),
        (r#"[{"of": "a", "rotate": {"axis": [0, 0, 1], "radians": 1}}]"#, "rotate.radians: unknown"),
        (r#"[{"of": "a", "grid": {"count": [1, 0, 1], "step": [1, 1, 1]}}]"#, "grid.count: three whole numbers"),
        (r#"[{"of": "a", "grid": {"count": [1, 1.5, 1], "step": [1, 1, 1]}}]"#, "grid.count: three whole numbers"),
        (r#"[{"of": "a", "grid": {"count": [1, 1, 1]}}]"#, "grid.step: is missing"),
        (
            r#"[{"of": "a"}, {"of": "a", "grid": {"count": [1000, 1000, 1], "step": [1, 1, 1]}}]"#,
            "instances[1]: more than 1000000 instances",
        ),
        (
            r#"[{"of": "a", "grid": {"count": [9000000000000000000, 9000000000000000000, 9], "step": [1, 1, 1]}}]"#,
            "more than 1000000 instances",
        ),
        (r#"[{"of": "a", "translate": [1e999, 0, 0]}]"#, "line 1"),
        (r#"[{"of": "a", "translate": [NaN, 0, 0]}]"#, "line 1"),
    ] {
        let error = scene(instances).unwrap_err().to_string();
        assert!(error.contains(says), "{instances}: {error}");
    }
    for (text, says) in [
        ("", "line 1"),
        ("[]", "the file: an object with inputs, instances"),
        ("{}", "inputs: is missing"),
        (r#"{"inputs": {"a": "a.ply"}}"#, "instances: is missing"),
        (r#"{"inputs": {}, "instances": []}"#, "inputs: an object with at least one"),
        (r#"{"inputs": {"a": 5}, "instances": []}"#, "inputs.a: a path"),
        (r#"{"inputs": {"a": ""}, "instances": []}"#, "inputs.a: a path"),
        (r#"{"inputs": {"a": "scene:nothing"}, "instances": []}"#, "inputs.a: there is no scene \"nothing\""),
        (r#"{"inputs": {"a": "other.JSON"}, "instances": []}"#, "no scenes in scenes"),
        (r#"{"inputs": {"a": "a.ply"}, "instances": [{"of": "a"}], "up": "z"}"#, "up: unknown"),
    ] {
        let error = parse(text, Path::new("")).unwrap_err().to_string();
        assert!(error.contains(says), "{text}: {error}");
    }
}
