% Episodes: the events that happened in them, their types, tasks and roles, and the relations of their intervals.
%
% Events are those of the episodes that were added to the knowledge base, and those that a map describes with
% knowrob:startTime. Times of an episode are seconds since its begin. The names of executes_task, has_participant and
% task_role are those of KnowRob 2 (prolog/model/DUL/Event.pl and EventType.pl).

:- module(mindstage_episodes,
          [ episode/1, episode/2, event_episode/2, event_type/2, event_agent/2,
            has_participant/2, has_participant/3, executes_task/2, task_role/3,
            before/2, after/2, meets/2, met_by/2, overlaps/2, overlapped_by/2, starts/2, started_by/2,
            contains/2, finishes/2, finished_by/2, equals/2, temporal_relation/3 ]).
:- use_module(questions).
:- use_module(prefixes).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(knowrob_objects).

%!  episode(?Name) is nondet.
%!  episode(?Name, ?Interval) is nondet.
%
%   The episodes of the knowledge base; Interval is [Begin, End] in seconds.
episode(Name) :- episode(Name, _).
episode(Name, [Begin, End]) :-
    request(episodes, Episodes),
    member(episode(Name, Begin, End), Episodes).

% happened(?Event, -Row): Row is event(Event, Class, Begin, End, Episode); End is none if it had not ended.
happened(Event, Row) :-
    expand_prefixes(Event, Given),
    request(episode_events(Given), Rows),
    member(Row, Rows),
    arg(1, Row, Iri),
    ( var(Event) -> Event = Iri ; true ).

%!  event_episode(?Event, ?Episode) is nondet.
event_episode(Event, Episode) :- happened(Event, event(_, _, _, _, Episode)).

%!  event_type(?Event, ?Class) is nondet.
%
%   The class of an event, such as ms:'PickingUp'; a given class may be more general.
event_type(Event, Class) :- var(Class), !, happened(Event, event(_, Class, _, _, _)).
event_type(Event, Class) :-
    full_name(Class, class, Iri),
    happened(Event, event(Name, _, _, _, _)),
    request(event_is(Name, Iri), true).

%!  event_agent(?Event, ?Agent) is nondet.
%
%   The body, or the name of the client, that caused an event.
event_agent(Event, Agent) :-
    expand_prefixes([Event, Agent], [Given, Wanted]),
    request(event_agents(Given), Rows),
    member(Iri-Wanted, Rows),
    ( var(Event) -> Event = Iri ; true ),
    ( var(Agent) -> Agent = Wanted ; true ).

%!  has_participant(?Event, ?Participant) is nondet.
%!  has_participant(?Event, ?Participant, ?Class) is nondet.
%
%   The things that took part in an event, with their classes.
has_participant(Event, Participant) :-
    full_name(Participant, individual, Iri),
    role(Event, role(_, _, _, _, Iri, _)),
    bind(Participant, Iri).
has_participant(Event, Participant, Class) :-
    full_name(Participant, individual, Iri),
    full_name(Class, class, ClassIri),
    role(Event, role(_, _, _, _, Iri, ClassIri)),
    bind(Participant, Iri),
    bind(Class, ClassIri).

role(Event, Row) :-
    expand_prefixes(Event, Given),
    request(event_roles(Given), Rows),
    member(Iri-Row, Rows),
    ( var(Event) -> Event = Iri ; true ).

%!  executes_task(?Event, ?Task) is nondet.
%
%   The task of an action, or the type of a state or process; each event has its own.
executes_task(Event, Task) :-
    ( var(Event) -> Given = Event ; once(happened(Event, event(Given, _, _, _, _))) ),
    expand_prefixes(Task, Wanted),
    request(event_tasks, Rows),
    member(Given-Wanted, Rows),
    ( var(Event) -> Event = Given ; true ),
    ( var(Task) -> Task = Wanted ; true ).

%!  task_role(?Task, ?Role, ?Class) is nondet.
%
%   The roles of the participants of a task, with their classes, such as soma:'Patient'.
task_role(Task, Role, Class) :-
    expand_prefixes([Task, Role, Class], [GivenTask, GivenRole, GivenClass]),
    role(_, role(GivenTask, _, GivenRole, GivenClass, _, _)),
    ( var(Task) -> Task = GivenTask ; true ),
    ( var(Role) -> Role = GivenRole ; true ),
    ( var(Class) -> Class = GivenClass ; true ).

% -- Allen's relations -------------------------------------------------------------------------------------------------

%!  temporal_relation(?A, ?B, ?Relation) is nondet.
%
%   The one of the thirteen relations of Allen (1983) that two events of one episode have, or two intervals
%   [Begin, End]: before, after, meets, met_by, overlaps, overlapped_by, starts, started_by, during, contains,
%   finishes, finished_by or equals.
temporal_relation(A, B, Relation) :-
    timed(A, Episode, Begin-End),
    timed(B, Episode, OtherBegin-OtherEnd),
    \+ ( atom(A), A == B ),
    allen(Begin, End, OtherBegin, OtherEnd, Found),
    Relation = Found.

% timed(?Event, ?Episode, -Interval): intervals that are given belong to every episode.
timed(Interval, _, Begin-End) :-
    nonvar(Interval), Interval = [Begin, End], !,
    must_be(number, Begin),
    must_be(number, End).
timed(Event, Episode, Begin-End) :-
    happened(Event, event(_, _, Begin, Stop, Episode)),
    ( Stop == none -> once(episode(Episode, [_, End])) ; End = Stop ).
timed(Event, '', Begin-End) :-
    \+ is_episode_event(Event),
    described_event(Event, Begin, Stop),
    ( var(Stop) -> End = inf ; End = Stop ).

allen(B, E, B2, E2, Relation) :- B =:= B2, !, ( E =:= E2 -> Relation = equals ; E < E2 -> Relation = starts ; Relation = started_by ).
allen(B, E, B2, E2, Relation) :- B > B2, !, allen(B2, E2, B, E, Other), inverse(Other, Relation).
allen(_, E, _, E2, finished_by) :- E =:= E2, !.
allen(_, E, _, E2, contains) :- E > E2, !.
allen(_, E, B2, _, before) :- E < B2, !.
allen(_, E, B2, _, meets) :- E =:= B2, !.
allen(_, _, _, _, overlaps).

inverse(before, after).
inverse(meets, met_by).
inverse(overlaps, overlapped_by).
inverse(contains, during).
inverse(finished_by, finishes).

before(A, B) :- temporal_relation(A, B, before).
after(A, B) :- temporal_relation(A, B, after).
meets(A, B) :- temporal_relation(A, B, meets).
met_by(A, B) :- temporal_relation(A, B, met_by).
overlaps(A, B) :- temporal_relation(A, B, overlaps).
overlapped_by(A, B) :- temporal_relation(A, B, overlapped_by).
starts(A, B) :- temporal_relation(A, B, starts).
started_by(A, B) :- temporal_relation(A, B, started_by).
% during/2 is that of knowrob_language.pl, which compares statements too.
contains(A, B) :- temporal_relation(A, B, contains).
finishes(A, B) :- temporal_relation(A, B, finishes).
finished_by(A, B) :- temporal_relation(A, B, finished_by).
equals(A, B) :- temporal_relation(A, B, equals).
