//! Measurement (not part of the product).
use lenscube_formats::design::builtin::BuiltinLens;
use pipeline::design::bundle::Bundle;
use pipeline::design::film_pixel::FilmPixels;
use pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use pipeline::design::ray::Tracer;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::Instant;

const FILM: f64 = 2.0;

struct Rng(u64);
impl Rng {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Exponents of total degree ≤ p.
fn powers(p: i32) -> Vec<(i32, i32)> {
    (0..=p).flat_map(|s| (0..=s).map(move |a| (a, s - a))).collect()
}
fn padua(p: i32) -> Vec<(f64, f64)> {
    let pi = std::f64::consts::PI;
    let mut v = vec![];
    for j in 0..=p {
        for k in 0..=p + 1 {
            if (j + k) % 2 == 1 {
                v.push(((f64::from(j) * pi / f64::from(p)).cos(), (f64::from(k) * pi / f64::from(p + 1)).cos()));
            }
        }
    }
    v
}
/// Weights at (x, y): solve Vᵀ w = v(x).
fn weights(p: i32, x: f64, y: f64) -> Vec<f64> {
    let (e, q) = (powers(p), padua(p));
    let n = e.len();
    assert_eq!(n, q.len());
    let t = |k: i32, x: f64| (f64::from(k) * x.clamp(-1.0, 1.0).acos()).cos();
    let mut a: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let mut r: Vec<f64> = q.iter().map(|(qx, qy)| t(e[i].0, *qx) * t(e[i].1, *qy)).collect();
            r.push(t(e[i].0, x) * t(e[i].1, y));
            r
        })
        .collect();
    for c in 0..n {
        let best = (c..n).max_by(|i, j| a[*i][c].abs().total_cmp(&a[*j][c].abs())).unwrap();
        a.swap(c, best);
        for r in 0..n {
            if r != c {
                let f = a[r][c] / a[c][c];
                for k in c..=n {
                    let v = a[c][k];
                    a[r][k] -= f * v;
                }
            }
        }
    }
    (0..n).map(|i| a[i][n] / a[i][i]).collect()
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let (name, nm, places): (&str, f64, usize) = (&args[1], args[2].parse().unwrap(), args[3].parse().unwrap());
    // Candidates: "l:100" linear of step 100, "p2:200" Padua degree 2, block 200.
    let kinds: Vec<(i32, f64)> = args[4..]
        .iter()
        .map(|a| {
            let (k, b) = a.split_once(':').unwrap();
            (k.trim_start_matches('p').trim_start_matches('l').parse().unwrap_or(0), b.parse().unwrap())
        })
        .collect();
    let system = BuiltinLens::named(name).unwrap().system();
    let tracer = Tracer::new(&system, nm / 1e3).unwrap();
    let last = match name {
        "double-gauss-28" => 20.5,
        _ => {
            let tracer = Tracer::new(&system, system.primary_um()).unwrap();
            let tans = system.fields.iter().map(|f| pipeline::design::describe::field_tan(&system, &tracer.primary, *f).abs());
            let tan = tans.fold(0.0, f64::max);
            if tan == 0.0 { tracer.image_circle_mm().unwrap() } else { tracer.chief_height_mm(tan).unwrap() }
        }
    };
    let bundles: Vec<Bundle> = (0..5)
        .map(|i| Bundle::trace(&tracer, tracer.field_of_height(last * f64::from(i) / 4.0).unwrap(), 12, 16).unwrap())
        .collect();
    let guess = |e: f64| bundles.iter().map(|b| b.window_px(e, FILM, 401).unwrap_or(401)).max().unwrap();
    let (window, core) = (guess(0.99), guess(0.95));
    let nyquist = bundles.iter().map(Bundle::nyquist_um).fold(f64::INFINITY, f64::min);
    let pitch = FILM / (FILM / (0.9 * nyquist)).ceil();
    let coarse = (1.5 * pitch).min(0.5 * FILM).max(pitch);
    let half = ((core as f64 * FILM / coarse - 1.0 + 1e-9) / 2.0).floor() as usize;
    let grid = PsfGrid::new(half, coarse);
    let film = FilmPixels::new(grid.size(), coarse, core, FILM);
    let found: Mutex<BTreeMap<usize, Vec<f64>>> = Mutex::default();
    let times = Mutex::new((0usize, 0.0, 0.0));
    std::thread::scope(|s| {
        for thread in 0..2 {
            let (tracer, grid, film, kinds, found, times) = (&tracer, &grid, &film, &kinds, &found, &times);
            s.spawn(move || {
                let mut scratch = PsfScratch::default();
                let mut psf = vec![];
                let mut kernel = |x: f64, y: f64| -> Option<Vec<f64>> {
                    let t = Instant::now();
                    let tan = tracer.field_of_height(x.hypot(y)).ok()?;
                    let f = PupilFunction::trace(tracer, tan).ok()?;
                    let a = t.elapsed().as_secs_f64();
                    grid.psf_into(&f, y.atan2(x), &mut scratch, &mut psf);
                    let k = film.integrate(&psf);
                    let sum: f64 = k.iter().sum();
                    let mut t2 = times.lock().unwrap();
                    t2.0 += 1;
                    t2.1 += a;
                    t2.2 += t.elapsed().as_secs_f64() - a;
                    Some(k.into_iter().map(|v| v / sum).collect())
                };
                for place in (thread..places).step_by(2) {
                    let mut rng = Rng(place as u64 * 7919 + 17);
                    let (r, a) = (0.985 * last * rng.next().sqrt(), std::f64::consts::TAU * rng.next());
                    let (x, y) = (r * a.cos(), r * a.sin());
                    let Some(truth) = kernel(x, y) else { continue };
                    let (u, v) = (rng.next(), rng.next());
                    for (i, (p, side)) in kinds.iter().enumerate() {
                        let mm = side * FILM * 1e-3;
                        let nodes: Vec<(f64, f64, f64)> = if *p == 0 {
                            vec![
                                (x - u * mm, y - v * mm, (1.0 - u) * (1.0 - v)),
                                (x + (1.0 - u) * mm, y - v * mm, u * (1.0 - v)),
                                (x - u * mm, y + (1.0 - v) * mm, (1.0 - u) * v),
                                (x + (1.0 - u) * mm, y + (1.0 - v) * mm, u * v),
                            ]
                        } else {
                            let (qx, qy) = (2.0 * u - 1.0, 2.0 * v - 1.0);
                            let w = weights(*p, qx, qy);
                            padua(*p)
                                .iter()
                                .zip(w)
                                .map(|((nx, ny), w)| (x + (nx - qx) * 0.5 * mm, y + (ny - qy) * 0.5 * mm, w))
                                .collect()
                        };
                        let mut sum = vec![0.0; truth.len()];
                        let mut ok = true;
                        for (x, y, w) in nodes {
                            let Some(k) = kernel(x, y) else {
                                ok = false;
                                break;
                            };
                            sum.iter_mut().zip(k).for_each(|(s, v)| *s += w * v);
                        }
                        if ok {
                            let l1: f64 = sum.iter().zip(&truth).map(|(a, b)| (a - b).abs()).sum();
                            found.lock().unwrap().entry(i).or_default().push(100.0 * l1);
                        }
                    }
                }
            });
        }
    });
    let t = times.lock().unwrap();
    println!(
        "{name} {nm} nm: last {last:.2} mm, window {window} px, core {core} px, {}² samples of {coarse:.3} µm (own pitch {pitch:.3}); per kernel: function {:.1} ms, PSF {:.1} ms",
        grid.size(), 1e3 * t.1 / t.0 as f64, 1e3 * t.2 / t.0 as f64
    );
    for (i, v) in found.lock().unwrap().iter_mut() {
        v.sort_by(f64::total_cmp);
        let at = |q: f64| v[((v.len() - 1) as f64 * q) as usize];
        println!("  {:>8}: n {} median {:.2} p90 {:.2} worst {:.2}", args[4 + i], v.len(), at(0.5), at(0.9), at(1.0));
    }
}
