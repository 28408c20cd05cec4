% Perceptions that are asserted, as in KnowRob's add-ons for logs.
:- module(lab_perception, [ see/2, seen/2, visible_at/3 ]).
:- use_module(library('semweb/rdf_db')).
:- use_module(library('knowrob_perception')).
:- use_module(library(jpl)).
:- jpl_call('org.knowrob.Main', start, [], _).
:- rdf_meta see(r,?), seen(r,?).
see(Type, Obj) :-
    rdf_instance_from_class(Type, Obj),
    rdf_instance_from_class(knowrob:'VisualPerception', P),
    rdf_assert(P, knowrob:objectActedOn, Obj),
    get_timepoint(T), rdf_assert(P, knowrob:startTime, T).
seen(Obj, T) :- rdf_has(P, knowrob:objectActedOn, Obj), rdf_has(P, knowrob:startTime, T).
visible_at(Obj, T, [X,Y,Z]) :- object_pose_at_time(Obj, T, pose([X,Y,Z], [_,_,_,_])).
