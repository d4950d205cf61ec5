//! Named spectra, and scenes that cannot be shown.

use super::*;
use crate::scene::description::{Light, LightKind};
use crate::scene::weights::LightSpectrum;

fn paint(name: &str) -> Spectrum {
    Spectrum::new(name, vec![400.0, 700.0], vec![0.2, 0.8], 1.0).unwrap()
}

#[test]
fn named_spectra_have_bases_of_their_own_in_each_light() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0)).with(1, wall(1.0, 0.1)).with(2, wall(0.5, 0.01));
    let materials = [
        material("plain", [0.5; 3]),
        textured(material("wood", [0.5; 3])),
        textured(material("cloth", [0.5; 3])),
    ];
    let named = |name: &str| materials_named(&materials, name).unwrap();
    let assigned = [
        Assigned { materials: named("cloth"), spectrum: paint("b.csv"), times_texture: true },
        Assigned { materials: named("wood"), spectrum: paint("a.csv"), times_texture: false },
    ];
    let colour = LightSpectrum::Colour([1.0, 0.0, 0.0]);
    let lamp = [Light {
        name: "red".into(),
        // It shines along +z.
        to_world: [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
        colour: [1.0, 0.0, 0.0],
        intensity: 500.0,
        kind: LightKind::Directional,
    }];
    let light = lighting(LightRequest { lights: &lamp, ..light(None, Some(1000.0)) });
    let mut request = request(&mesh, &materials, light);
    request.assigned = &assigned;
    request.textures = vec![picture(1, 1, |_, _| [255, 0, 0, 255])];
    let appearance = Appearance::new(request).unwrap();
    let bases = appearance.list_of_bases();
    assert_eq!(
        (bases.len(), bases[3].name(), bases[4].name(), &bases[8].light),
        (10, "b.csv", "a.csv", &colour)
    );
    assert_eq!(
        appearance.notes(),
        ["the texture of material `wood` is ignored: its reflectance is the spectrum `a.csv`"]
    );
    // The sky's light is the illuminant's, the lamp's half of it.
    let places = [
        (0.4, [0.5, 0.5, 0.5, 0.0, 0.0]),
        (0.05, [0.0, 0.0, 0.0, 0.0, 1.0]),
        (0.0, [0.0, 0.0, 0.0, 0.2126, 0.0]),
    ];
    for (x, expected) in places {
        let mut found = seen(&appearance, &mesh, x, 0.001).into_iter();
        for unit in [1.0, 0.5] {
            for (r, (found, expected)) in found.by_ref().zip(expected).take(5).enumerate() {
                // The nearest wall shades one or two of 64 directions of the one behind it.
                let shaded = unit * expected * 2.0 / 64.0;
                assert!(
                    (found - unit * expected).abs() < 1e-12 + shaded,
                    "{x}, reflectance {r}: {found}, {unit} {expected}"
                );
            }
        }
    }
}

#[test]
fn scenes_that_cannot_be_shown_are_errors() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0));
    let plain = [material("plain", [0.5; 3]), material("other", [0.5; 3])];
    let error = |change: &dyn Fn(&mut AppearanceRequest<'_, TestMesh>)| {
        let mut request = request(&mesh, &plain, Lighting::even(1000.0));
        change(&mut request);
        Appearance::new(request).err().expect("an error").to_string()
    };
    let unknown = materials_named(&plain, "wood").unwrap_err().to_string();
    assert_eq!(unknown, "no material is called `wood`; the materials are `other`, `plain`");
    assert!(error(&|r| r.background = Background::Luminance(f64::NAN)).contains("NaN cd/m²"));
    let with = |materials: Vec<usize>, times_texture| Assigned {
        materials,
        spectrum: paint("a.csv"),
        times_texture,
    };
    let assign = |assigned: &[Assigned]| {
        let request = AppearanceRequest { assigned, ..request(&mesh, &plain, Lighting::even(1.0)) };
        Appearance::new(request).err().expect("an error").to_string()
    };
    assert_eq!(
        assign(&[with(vec![0], false), with(vec![1, 0], false)]),
        "material `plain` has two spectra, `a.csv` and `a.csv`"
    );
    assert!(assign(&[with(vec![0], true)]).contains("`plain` has no texture"));
    assert_eq!(
        assign(&[with(vec![7], false)]),
        "material of spectrum `a.csv`, number 7 does not exist: there are 2"
    );
    let refer = |mesh: &TestMesh, materials: &[Material]| {
        Appearance::new(request(mesh, materials, Lighting::even(1.0)))
            .map(|a| a.notes().join(";"))
            .map_err(|e| e.to_string())
    };
    let nowhere = TestMesh::default().with(2, wall(2.0, 1.0));
    assert_eq!(
        refer(&nowhere, &plain).unwrap_err(),
        "material of part `part 0`, number 2 does not exist: there are 2"
    );
    let wood = [textured(material("wood", [0.5; 3]))];
    assert_eq!(
        refer(&mesh, &wood).unwrap_err(),
        "texture of material `wood`, number 0 does not exist: there are 0"
    );
    let short =
        TestMesh::default().with(0, Geometry { normals: vec![[0.0, 0.0, 1.0]].into(), ..wall(2.0, 1.0) });
    assert_eq!(refer(&short, &plain).unwrap_err(), "part `part 0` has 1 normals for 4 vertices");
    let bare = TestMesh::default().with(0, Geometry { texcoords: Vec::new(), ..wall(2.0, 1.0) });
    let mut request = request(&bare, &wood, Lighting::even(1.0));
    request.textures = vec![picture(1, 1, |_, _| [0, 0, 0, 255])];
    let appearance = Appearance::new(request).unwrap();
    assert_eq!(
        appearance.notes(),
        ["part `part 0` has no texture coordinates of set 0: a texture of its material `wood` is not used"]
    );
    assert_eq!(seen(&appearance, &bare, 0.1, 0.1), [0.5; 3]);
}
