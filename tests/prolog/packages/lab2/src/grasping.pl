% Questions in KnowRob 2's language, with its operators and paths.
:- module(lab_grasping, [ grasp_handle(r,?), grasp_all/1, count_below/2, mass_during/3, remember/1, op(700, xfx, grasped_by) ]).
:- use_module(library('lang/query')).
:- use_module(library('utility/algorithm'), [ set_difference/3 ]).
:- rdf_meta(count_below(r,-)).
:- dynamic(grasp_cache/2).
grasp_handle(Obj, Handle) :-
    ask([ instance_of(Obj, knowrob:'Door'), has_part(Obj, Handle), instance_of(Handle, knowrob:'Handle') ]).
grasp_all(Hs) :- kb_call(findall(H, instance_of(H, knowrob:'Handle'), Hs)).
count_below(O, N) :- aggregate_all(count, ask(triple(O, transitive(knowrob:child), _)), N).
mass_during(O, M, T) :- kb_call(triple(O, knowrob:mass, M) during T).
remember(O) :- tell([ is_individual(O), triple(O, rdf:type, knowrob:'Cup') ]).
