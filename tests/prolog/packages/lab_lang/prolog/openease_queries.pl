% queries as they are put at openEASE
:- use_module(library(knowrob_vis)).
:- use_module(library('knowrob_temporal')).
milk(X) :- entity(X, [a, thing, [type, milk]]).
milk_pose(X, Pose) :- milk(X), get_timepoint(T), object_pose_at_time(X, T, pose([PX,PY,PZ], _)), Pose = [PX,PY,PZ].
show_all(Class) :- findall(X, owl_individual_of(X, Class), Xs), show(Xs).
where(X, Y) :- holds(in_ContGeneric(X, Y)).
where_then(X, Y, T) :- holds(knowrob:'in-ContGeneric'(X, Y), T).
recent(Ev) :- occurs(Ev, [B, _]), get_timepoint(Now), B < Now.
store_at(X, P) :- rdfs_individual_of(X, C), storagePlaceFor(P, C).
grasp_points(X, H) :- rdf_has(X, knowrob:child, H), rdfs_individual_of(H, knowrob:'Handle').
label(X, L) :- rdf_split_url(_, L, X).
