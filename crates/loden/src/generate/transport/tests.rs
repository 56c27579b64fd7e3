use super::*;

/// Numbers of 0..1 without a pattern.
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The least cost of an assignment, over all permutations.
fn assignment(costs: &[Vec<f64>], from: usize, used: u32) -> f64 {
    let free = (0..costs.len()).filter(|to| used & 1 << to == 0);
    free.map(|to| {
        costs[from][to] + if from + 1 < costs.len() { assignment(costs, from + 1, used | 1 << to) } else { 0.0 }
    })
    .fold(f64::INFINITY, f64::min)
}

/// Checks that flows have the right sums and that the potentials prove the plan to be optimal.
fn certify(plan: &Plan, sources: &[f64], targets: &[f64], cost: Cost, tolerance: f64) {
    let total = |masses: &[f64]| masses.iter().sum::<f64>();
    let sum = |of: &dyn Fn(&Flow) -> bool| plan.flows.iter().filter(|flow| of(flow)).map(|flow| flow.mass).sum::<f64>();
    for (i, mass) in sources.iter().enumerate() {
        assert!((sum(&|flow| flow.from == i) - mass / total(sources)).abs() < 1e-14, "source {i}");
    }
    for (j, mass) in targets.iter().enumerate() {
        assert!((sum(&|flow| flow.to == j) - mass / total(targets)).abs() < 1e-14, "target {j}");
    }
    let [u, v] = &plan.potentials;
    assert_eq!((u.len(), v.len()), (sources.len(), targets.len()));
    for (i, u) in u.iter().enumerate() {
        for (j, v) in v.iter().enumerate() {
            assert!(u + v <= cost(i, j) + tolerance, "({i}, {j}): {u} + {v} > {}", cost(i, j));
        }
    }
    for Flow { from, to, mass } in &plan.flows {
        assert!(*mass > 0.0 && (u[*from] + v[*to] - cost(*from, *to)).abs() <= tolerance, "({from}, {to})");
    }
    let dual = u.iter().zip(sources).map(|(u, m)| u * m / total(sources)).sum::<f64>()
        + v.iter().zip(targets).map(|(v, m)| v * m / total(targets)).sum::<f64>();
    assert!((dual - plan.cost).abs() < 1e-12 * plan.cost.abs().max(1e-3), "{dual} {}", plan.cost);
}

#[test]
fn small_plans_are_as_cheap_as_the_best_of_all_permutations() {
    let mut next = random(1);
    for n in 1..=7 {
        for whole in [false, true] {
            // whole costs have many ties
            let costs: Vec<Vec<f64>> =
                (0..n).map(|_| (0..n).map(|_| if whole { (next() * 4.0).floor() } else { next() }).collect()).collect();
            let masses = vec![3.0; n];
            let found = plan(&masses, &masses, &|i, j| costs[i][j]).unwrap();
            let best = assignment(&costs, 0, 0) / n as f64;
            assert!((found.cost - best).abs() < 1e-14 * best.max(1.0), "{n}: {} {best}", found.cost);
            certify(&found, &masses, &masses, &|i, j| costs[i][j], 1e-12);
        }
    }
}

#[test]
fn the_dual_proves_plans_of_many_rows_to_be_optimal() {
    for (n, m, zeros) in [(256, 256, false), (256, 256, true), (300, 40, true), (1, 9, false), (9, 1, false)] {
        let mut next = random(n as u64 + 7 * m as u64);
        let mut masses = |count: usize| -> Vec<f64> {
            let mass = |k: usize, v: f64| if zeros && k % 5 == 1 { 0.0 } else { (v * 50.0).ceil() };
            (0..count).map(|k| mass(k, next())).collect()
        };
        let (a, b) = (masses(n), masses(m));
        let points: Vec<[f64; 3]> = (0..n + m).map(|_| std::array::from_fn(|_| next())).collect();
        let cost = |i: usize, j: usize| (0..3).map(|k| (points[i][k] - points[n + j][k]).powi(2)).sum::<f64>();
        let found = plan(&a, &b, &cost).unwrap();
        certify(&found, &a, &b, &cost, 1e-11);
        assert!(found.flows.len() < n + m, "a tree");
        let soft = regularised(&a, &b, &cost, 0.02).unwrap();
        assert!(soft.cost >= found.cost - 1e-8, "{} {}", soft.cost, found.cost);
    }
}

#[test]
fn regularised_plans_approach_the_exact_one_and_never_overflow() {
    let cost = |i: usize, j: usize| (i as f64 - j as f64).powi(2);
    let (a, b) = ([1.0, 2.0, 0.0, 3.0], [2.0, 1.5, 2.0, 0.5]);
    let exact = plan(&a, &b, &cost).unwrap().cost;
    let soft = [1.0, 0.3, 0.08].map(|epsilon| regularised(&a, &b, &cost, epsilon).unwrap().cost);
    assert!(soft[0] > soft[1] && soft[1] > soft[2] && (soft[2] - exact).abs() < 1e-4, "{soft:?} {exact}");
}

#[test]
fn mass_stays_where_it_is_if_it_can() {
    let masses: Vec<f64> = (0..50).map(|k| f64::from(k % 7)).collect();
    let found = plan(&masses, &masses, &|i, j| (i as f64 - j as f64).abs()).unwrap();
    assert_eq!(found.cost, 0.0);
    assert!(found.flows.iter().all(|flow| flow.from == flow.to));
    let largest = found.largest(50);
    assert!((0..50).all(|k| largest[k] == (masses[k] > 0.0).then_some(k)));
    // all costs equal: the numbers of rows decide, so a plan is found twice the same
    let flat = [(); 2].map(|()| plan(&masses, &[1.0; 30], &|_, _| 2.0).unwrap());
    assert!(flat[0] == flat[1] && (flat[0].cost - 2.0).abs() < 1e-15);
    assert_eq!(plan(&[1.0], &[2.0, 0.0], &|_, _| 0.0).unwrap().flows, [Flow { from: 0, to: 0, mass: 1.0 }]);
}

#[test]
fn plans_do_not_depend_on_the_number_of_threads() {
    let cost = |i: usize, j: usize| ((i * 37 + j * 101) % 64) as f64;
    let masses: Vec<f64> = (0..200).map(|k| 1.0 + (k % 3) as f64).collect();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| plan(&masses, &masses[..150], &cost).unwrap())
    };
    assert_eq!(with(1), with(2));
}

#[test]
fn wrong_masses_and_costs_are_named() {
    let error = |a: &[f64], b: &[f64], c: f64| plan(a, b, &|_, _| c).unwrap_err().to_string();
    assert_eq!(error(&[], &[1.0], 0.0), "sources: found 0 masses, expected 1 to 65536");
    assert_eq!(error(&[1.0], &[1.0, -1.0], 0.0), "targets: mass 1 is -1, expected a finite number of at least 0");
    assert_eq!(error(&[0.0], &[1.0], 0.0), "sources: the masses add up to 0");
    assert_eq!(error(&[1.0], &[1.0], f64::NAN), "cost: a cost of source 0 is not finite");
    assert!(regularised(&[1.0], &[1.0], &|_, _| 0.0, 0.0).unwrap_err().to_string().starts_with("epsilon"));
    assert!(memory(4096, 4096) < 1 << 30 && memory(65_536, 65_536) < 1 << 30);
}
