% A file in the manner of KnowRob's packages.
:- module(lab_episodes, [ ep_event/2, ep_duration/2, ep_objects/2, ep_create/3 ]).
:- use_module(library('semweb/rdf_db')).
:- use_module(library('knowrob/lang/ask'),  [ kb_triple/3, kb_type_of/2 ]).
:- use_module(library('knowrob/lang/tell'), [ kb_create/3, kb_assert/3, kb_retract/3 ]).
:- use_module(library('knowrob/model/Event')).
:- use_module(library('knowrob/temporal')).
:- dynamic ep_cache/2.
:- multifile user:ep_hook/1.
:- discontiguous ep_event/2.
:- rdf_meta ep_event(r,r), ep_objects(r,-), ep_create(r,-,+).
ep_event(Evt, Type) :- kb_type_of(Evt, Type).
ep_duration(Evt, D) :- occurs(Evt, [B,E]), D is E - B.
ep_event(Evt, Type) :- kb_triple(Evt, dul:isClassifiedBy, Tsk), kb_type_of(Tsk, Type).
ep_objects(Evt, Objs) :- findall(O, kb_triple(Evt, dul:hasParticipant, O), Objs).
ep_create(Type, Evt, Graph) :-
    kb_create(Type, Evt, _{graph:Graph}),
    kb_create(dul:'TimeInterval', I, _{graph:Graph}),
    kb_assert(Evt, dul:hasTimeInterval, I).
